"""Files that a caller may have read: regular files below allowed folders, and nothing else.

The server reads files with the rights of whoever started it, and an agent chooses the paths. So every path of a call
goes through `AllowedFiles`: symbolic links are resolved before the check, files are opened without following links
and checked once open, and a refusal says nothing about what lies outside.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Literal

from atw_mcp.calls.limits import Limits

VARIABLE = "ATW_MCP_ALLOW"
DEMO = Path(__file__).resolve().parents[1] / "demo"  # shipped with the package, readable by everyone
SYSTEM = tuple(Path(p) for p in ("/proc", "/sys", "/dev"))  # refused even below an allowed folder
LONGEST = 4096  # characters of a path, PATH_MAX of Linux
LISTED = 10  # names that an error lists
SHOWN = 200  # characters of a path that an error repeats
# A file that was opened and checked is read through its descriptor where the system shows those as files: whatever
# happens to the path meanwhile, it is that file. Not /dev/fd, which on other systems shares one position.
DESCRIPTORS = Path("/proc/self/fd")
_OPEN = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


class FileRefused(ValueError):
    """A path that may not or cannot be read; the message says where files may lie."""


class AllowedFiles:
    """Checks and opens the files that calls name.

    folders: folders, or single files, whose content may be read. own: folders of this server's own data, readable
    as well but not named in messages.
    """

    def __init__(self, folders: Iterable[Path], limits: Limits, own: Iterable[Path] = ()) -> None:
        self._folders = list(dict.fromkeys(Path(os.path.realpath(folder.expanduser())) for folder in folders))
        self._own = (DEMO, *(Path(os.path.realpath(folder)) for folder in own))
        self._roots: list[Path] | None = None
        self._limits = limits

    @property
    def folders(self) -> tuple[Path, ...]:
        """Folders and files that may be read, besides the server's own."""
        return tuple(dict.fromkeys([*self._folders, *(self._roots or [])]))

    @property
    def roots_known(self) -> bool:
        """Whether the client was asked for its roots."""
        return self._roots is not None

    def set_roots(self, roots: Iterable[Path]) -> None:
        """Allow the folders that the one client of this process offers as its roots."""
        self._roots = [Path(os.path.realpath(root)) for root in roots]

    def resolve(self, text: str) -> Path:
        """Return the real path of a regular file or folder that may be read.

        Raises FileRefused for a path outside the allowed folders, whether or not there is anything, and inside them
        for what is missing (naming what is near) or neither file nor folder.
        """
        path = self._allowed(text)
        try:
            mode = path.stat().st_mode
        except OSError as error:
            raise FileRefused(self._missing(path)) from error
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise FileRefused(f"{path} is neither a regular file nor a folder")
        return path

    def file(self, text: str) -> Path:
        """Return the real path of a regular, non-empty file within the limit of file_bytes; raises FileRefused."""
        path = self.resolve(text)
        if path.is_dir():
            raise FileRefused(f"{path} is a folder, not a file{_names_in(path)}")
        descriptor = self._open(path)
        try:
            self._check_size(path, os.fstat(descriptor).st_size, "file_bytes")
        finally:
            os.close(descriptor)
        return path

    def film(self, text: str) -> Path:
        """Return the real path of a video file, or of a folder of pictures within the limits; raises FileRefused."""
        path = self.resolve(text)
        if not path.is_dir():
            return self.file(text)
        files = [item for item in path.iterdir() if item.is_file() and not item.is_symlink()]
        if len(files) > self._limits.folder_files:
            raise FileRefused(f"{path} has more than {self._limits.folder_files} files, the limit (folder_files)")
        self._check_size(path, sum(item.stat().st_size for item in files), "file_bytes")
        return path

    @contextmanager
    def opened(self, text: str, limit: Literal["file_bytes", "text_bytes"] = "file_bytes") -> Iterator[Path]:
        """Yield a path under which a file, or a private copy of a folder's regular files, can be read without races.

        The path has the name of the original, in a temporary folder of its own, so that no file beside it can be
        reached. Links in a folder are followed only to allowed files. limit: that of a file's size; of folders it is
        file_bytes. Raises FileRefused.
        """
        path = self.resolve(text)
        with tempfile.TemporaryDirectory(prefix="atw-read-") as own:
            view = Path(own) / (path.name or "root")
            if path.is_dir():
                self._copy_folder(path, view)
                yield view
                return
            descriptor = self._open(path)
            try:
                self._check_size(path, os.fstat(descriptor).st_size, limit)
                if DESCRIPTORS.is_dir():
                    view.symlink_to(DESCRIPTORS / str(descriptor))
                else:
                    _copy(descriptor, view)
                yield view
            finally:
                os.close(descriptor)

    def shown(self, path: str) -> str:
        """Return a path for a reply: whole if it may be read, else the name alone."""
        try:
            return path if self._inside(Path(os.path.realpath(path))) else Path(path).name
        except (OSError, ValueError):
            return Path(path).name

    def redacted(self, text: str) -> str:
        """Return a message without paths of this installation, temporary folders and homes that may not be read."""
        kept = [str(folder) for folder in self.folders]
        for number, folder in enumerate(kept):
            text = text.replace(folder, f"\0{number}\0")
        for pattern, word in _private_folders():
            text = pattern.sub(word, text)
        return re.sub("\0([0-9]+)\0", lambda found: kept[int(found[1])], text)

    def _allowed(self, text: str) -> Path:
        if "://" in text:
            raise FileRefused(f"{_short(text)} is an address: give the path of the file alone, as /folder/film.mp4")
        if len(text) > LONGEST:  # resolving it would look at every folder on the way
            raise FileRefused(self._outside(text))
        try:
            path = Path(os.path.realpath(Path(text).expanduser()))
        except (OSError, ValueError, RuntimeError) as error:  # NUL, a loop of links, an unknown user's home
            raise FileRefused(self._outside(text)) from error
        if any(path.is_relative_to(folder) for folder in SYSTEM) or not self._inside(path):
            raise FileRefused(self._outside(text))
        return path

    def _inside(self, path: Path) -> bool:
        return any(path.is_relative_to(folder) for folder in (*self.folders, *self._own))

    def _open(self, path: Path) -> int:
        """Open a resolved path; refuses what is no regular file, or not the file at that path any more."""
        try:
            descriptor = os.open(path, _OPEN)
        except OSError as error:
            raise FileRefused(f"{path} cannot be opened: {error.strerror}") from error
        try:
            facts = os.fstat(descriptor)
            if not stat.S_ISREG(facts.st_mode):
                raise FileRefused(f"{path} is not a regular file")
            # A folder on the way may have become a link after it was resolved.
            now = Path(os.path.realpath(path))
            if now != path or not os.path.samestat(facts, os.stat(now)):
                raise FileRefused(f"{path} changed while it was opened: call again")
        except BaseException as error:
            os.close(descriptor)
            if isinstance(error, OSError):
                raise FileRefused(f"{path} changed while it was opened: call again") from error
            raise
        return descriptor

    def _copy_folder(self, folder: Path, target: Path) -> None:
        files = bytes_copied = 0
        most, limit = self._limits.folder_files, self._limits.file_bytes
        for parent, names, inside in os.walk(folder):  # does not enter links to folders
            names.sort()
            here = target / Path(parent).relative_to(folder)
            here.mkdir(parents=True)
            for name in sorted(inside):
                files += 1
                if files > most:
                    raise FileRefused(f"{folder} has more than {most} files, the limit (folder_files) of this server")
                real = self._allowed(str(Path(parent) / name))
                descriptor = self._open(real)
                try:
                    bytes_copied += os.fstat(descriptor).st_size
                    if bytes_copied > limit:
                        raise FileRefused(
                            f"{folder} has more than {limit:,} bytes, the limit (file_bytes) of this server"
                        )
                    _copy(descriptor, here / name)
                finally:
                    os.close(descriptor)

    def _check_size(self, path: Path, size: int, limit: Literal["file_bytes", "text_bytes"]) -> None:
        most: int = getattr(self._limits, limit)
        if size == 0:
            raise FileRefused(f"{path} is empty (0 bytes)")
        if size > most:
            raise FileRefused(f"{path} has {size:,} bytes, more than the limit of {most:,} ({limit}) of this server")

    def _outside(self, text: str) -> str:
        listed = ", ".join(map(str, self.folders[:LISTED])) or "none but the shipped demo"
        return (
            f"{_short(text)} is not in a folder whose files may be read; these are: {listed}. Put the file there, "
            f"or have the server started with --allow DIR (or the variable {VARIABLE}) for its folder"
        )

    def _missing(self, path: Path) -> str:
        parent = path.parent
        near = _names_in(parent) if self._inside(parent) and parent.is_dir() else "; nor is there its folder"
        return f"nothing at {_short(str(path))}{near}"


def allowed_folders(given: Iterable[Path]) -> list[Path]:
    """Return the folders to allow: those given, those of ATW_MCP_ALLOW, and the working folder.

    A working folder that is the root of a file system or the user's home counts only if it is given: programs that
    start servers often do so from there, and mean nothing by it.
    """
    folders = [*given, *(Path(part) for part in os.environ.get(VARIABLE, "").split(os.pathsep) if part)]
    with suppress(OSError, RuntimeError):
        here = Path.cwd().resolve()
        if here != Path(here.anchor) and here != Path.home().resolve():
            folders.append(here)
    return folders


@lru_cache(maxsize=1)
def _private_folders() -> tuple[tuple[re.Pattern[str], str], ...]:
    found = [(Path(__file__).resolve().parents[2], "<server>")]
    found += [(Path(sysconfig.get_path(name)).resolve(), "<python>") for name in ("purelib", "stdlib")]
    found += [(Path(sys.prefix), "<python>"), (Path(sys.base_prefix), "<python>")]
    found.append((Path(tempfile.gettempdir()), "<temporary>"))
    with suppress(RuntimeError):
        found.append((Path.home(), "<home>"))
    found = [(folder, word) for folder, word in found if folder != Path(folder.anchor)]
    found.sort(key=lambda item: -len(str(item[0])))  # the innermost first
    return tuple((re.compile(rf"{re.escape(str(folder))}(?![\w.-])"), word) for folder, word in found)


def _copy(descriptor: int, target: Path) -> None:
    with open(descriptor, "rb", closefd=False) as source, target.open("xb") as copy:
        shutil.copyfileobj(source, copy, 1 << 20)


def _names_in(folder: Path) -> str:
    with suppress(OSError):
        names = sorted(item.name for item in folder.iterdir())[:LISTED]
        return f"; that folder has {names}" if names else "; that folder is empty"
    return ""


def _short(text: str) -> str:
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
