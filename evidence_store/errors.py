"""Errors of a store; every message says what to do next."""


class StoreError(Exception):
    """The store could not do what was asked, and changed nothing."""


class StoreLocked(StoreError):
    """Another process kept the store locked for longer than the busy timeout."""


class StoreReadOnly(StoreError):
    """The store's file or folder cannot be written."""


class StoreDiskError(StoreError):
    """The operating system could not read or write the store's file."""


class StoreFull(StoreDiskError):
    """The disk has no room for what should be stored."""


class NotAStore(StoreError):
    """The file exists but is no evidence store: some other database, or no database at all."""


class StoreTooNew(StoreError):
    """The store was written by a newer version of this package."""


class StoreTooOld(StoreError):
    """The store was written by an older version of this package, and was opened to be read only."""


class StoreDamaged(StoreError):
    """The store's file is damaged: some of what was stored cannot be read."""


class RecordDamaged(StoreDamaged):
    """One record is not as it was written; other records can be read."""


class BadArchive(StoreError):
    """The file is no case that `export` wrote, or not as it was written."""


class UnknownRecord(StoreError):
    """No record of that kind has that id."""
