"""Errors of a store; every message says what to do next."""


class StoreError(Exception):
    """The store could not do what was asked; nothing already stored was lost."""


class StoreLocked(StoreError):
    """Another process kept the store locked for longer than the busy timeout."""


class StoreReadOnly(StoreError):
    """The store's file or folder cannot be written."""


class NotAStore(StoreError):
    """The file exists but is no evidence store: some other database, or no database at all."""


class StoreTooNew(StoreError):
    """The store was written by a newer version of this package."""


class UnknownRecord(StoreError):
    """No record of that kind has that id."""
