"""Power cuts: what the disk may hold of a program's writes, and how the next start copes with it.

The program runs under strace, which notes each system call that writes below a folder. The calls
are replayed on a model of the disk that knows what has been flushed: names by an fsync of their
folder, content by an fsync of the file. After each call the disk may hold any of several states, as
unflushed writes may be lost, and names may get there before content or the other way round. After
ALICE (Pillai et al., OSDI 2014) and CrashMonkey (Mohan et al., OSDI 2018).
"""

from __future__ import annotations

import hashlib
import os
import random
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from tests.commands import ended

_CALLS = (
    *("openat", "open", "creat", "write", "pwrite64", "writev", "pwritev", "lseek", "ftruncate"),
    *("truncate", "sendfile", "copy_file_range", "rename", "renameat", "renameat2", "link"),
    *("linkat", "symlink", "symlinkat", "unlink", "unlinkat", "mkdir", "mkdirat", "rmdir"),
    *("fsync", "fdatasync"),
)
_LINE = re.compile(
    r"(?P<time>\d+\.\d+) (?P<call>\w+)\((?P<arguments>.*)\)\s+= "
    r"(?P<result>-?\d+)(<(?P<path>[^>]*)>)?"
)
_TEXT = re.compile(r'"((?:\\x[0-9a-f]{2})*)"')
_FOLDER = re.compile(r"(?:AT_FDCWD|\d+)<((?:\\x[0-9a-f]{2})*)>")
_DESCRIPTOR = re.compile(r"(\d+)<((?:\\x[0-9a-f]{2})*)>")


def has_strace() -> bool:
    """Whether system calls can be noted here."""
    program = shutil.which("strace")
    return (
        program is not None and not subprocess.run([program, "-qq", "true"], check=False).returncode
    )


@dataclass
class Node:
    """A file: its content, and the content that is on the disk whatever happens."""

    content: bytes = b""
    flushed: bytes = b""

    def write(self, at: int, data: bytes) -> None:
        """Write at a place."""
        self.content = self.content[:at].ljust(at, b"\0") + data + self.content[at + len(data) :]


Name = Node | str | None
"""What a path leads to: a file, a link's target, or None for a folder."""


@dataclass
class Change:
    """A change of names: `path` now leads to `leads_to`, or nowhere."""

    kind: Literal["add", "remove", "move"]
    path: str
    leads_to: Name = None
    target: str = ""
    is_flushed: bool = False

    def apply(self, names: dict[str, Name]) -> None:
        """Make the change if what it needs exists."""
        parent = str(Path(self.path).parent)
        if self.kind == "add":
            if parent in names:
                names[self.path] = self.leads_to
            return
        below = [name for name in names if name == self.path or name.startswith(f"{self.path}/")]
        if self.kind == "remove":
            for name in below:
                del names[name]
        elif below and str(Path(self.target).parent) in names:
            for name in [n for n in names if n == self.target or n.startswith(f"{self.target}/")]:
                del names[name]
            for name in below:
                names[self.target + name[len(self.path) :]] = names.pop(name)

    @property
    def folders(self) -> set[str]:
        """The folders whose names it changes."""
        return {str(Path(path).parent) for path in (self.path, self.target) if path}


State = dict[str, bytes | str | None]
"""What a disk holds by path: a file's content, a link's target, or None for a folder."""


@dataclass
class Disk:
    """A model of the disk below a folder."""

    root: str
    names: dict[str, Name] = field(default_factory=dict)
    durable: dict[str, Name] = field(default_factory=dict)
    _before: dict[str, Name] = field(default_factory=dict)
    _changes: list[Change] = field(default_factory=list)

    @classmethod
    def of(cls, root: Path) -> Disk:
        """Return a model of a folder as it stands, all on the disk."""
        disk = cls(str(root))
        disk.names[str(root)] = None
        for path in sorted(root.rglob("*")):
            if path.is_symlink():
                disk.names[str(path)] = str(path.readlink())
            elif path.is_dir():
                disk.names[str(path)] = None
            else:
                disk.names[str(path)] = Node(path.read_bytes(), path.read_bytes())
        disk.durable, disk._before = dict(disk.names), dict(disk.names)
        return disk

    def real(self, path: str) -> str:
        """Return a path of which no folder is a link."""
        parent, name = os.path.split(path)
        if len(parent) <= len(self.root):
            return path
        parent = self.real(parent)
        target = self.names.get(parent)
        if isinstance(target, str):
            parent = self.real(os.path.normpath(Path(parent).parent / target))
        return str(Path(parent) / name)

    def change(self, change: Change) -> None:
        """Change names, not yet on the disk."""
        change.apply(self.names)
        self._changes.append(change)

    def flush(self, path: str) -> None:
        """Flush a file's content, or a folder's names."""
        found = self.names.get(path)
        if isinstance(found, Node):
            found.flushed = found.content
        elif path in self.names:
            for change in self._changes:
                change.is_flushed |= path in change.folders
            # From the beginning: names in a folder count once the folder's own name is flushed.
            self.durable = self._names_with(lambda change: change.is_flushed)

    def _names_with(self, is_kept: Callable[[Change], bool]) -> dict[str, Name]:
        """Return the names after some of the changes."""
        names = dict(self._before)
        for change in self._changes:
            if is_kept(change):
                change.apply(names)
        return names

    def states(self, rng: random.Random) -> Iterator[tuple[str, State]]:
        """Yield what the disk may hold after a power cut now, with what was lost."""
        yield "nothing lost", _state(self.names, lambda node: node.content)
        yield "content lost", _state(self.names, lambda node: node.flushed)
        yield "names lost", _state(self.durable, lambda node: node.content)
        yield "all unflushed lost", _state(self.durable, lambda node: node.flushed)
        names = self._names_with(lambda change: change.is_flushed or rng.random() < 0.5)

        def some(node: Node) -> bytes:
            cut = node.content[: len(node.content) // 2]
            return rng.choice(
                [node.content, node.flushed, cut if cut.startswith(node.flushed) else node.flushed]
            )

        yield "some lost", _state(names, some)


def _state(names: dict[str, Name], content: Callable[[Node], bytes]) -> State:
    return {
        path: content(found) if isinstance(found, Node) else found for path, found in names.items()
    }


def traced(command: Sequence[str], folder: Path, notes: Path) -> None:
    """Run a command under strace, which leaves a file for each thread in `notes`."""
    notes.mkdir()
    tracer = ["strace", "-ff", "-ttt", "-y", "-xx", "-s", str(2**24), "--seccomp-bpf"]
    tracer += ["-o", str(notes / "t"), "-e", f"trace={','.join(_CALLS)}"]
    done = ended(*tracer, *command, cwd=folder)
    assert done.returncode in {0, 10}, done.stderr[-3000:]


@dataclass(frozen=True)
class Call:
    """A system call that succeeded.

    `files` are the descriptors among its arguments with their paths, `texts` what is quoted, `last`
    the last argument, and `opened` the path of a file that it opens.
    """

    name: str
    arguments: str
    result: int
    opened: str

    @property
    def files(self) -> list[tuple[str, str]]:
        """Descriptors and their paths."""
        return [(number, _plain(path)) for number, path in _DESCRIPTOR.findall(self.arguments)]

    @property
    def texts(self) -> list[bytes]:
        """What is quoted: names, or content."""
        return [bytes.fromhex(one.replace("\\x", "")) for one in _TEXT.findall(self.arguments)]

    @property
    def last(self) -> int:
        """The last argument, as a number."""
        return int(self.arguments.rpartition(", ")[2])

    def paths(self, working: Path) -> list[str]:
        """Return the names among its arguments as absolute paths."""
        folders = [_plain(one) for one in _FOLDER.findall(self.arguments)] or [str(working)]
        return [
            os.path.normpath(Path(folders[min(i, len(folders) - 1)]) / text.decode())
            for i, text in enumerate(self.texts)
        ]


def calls_in(notes: Path) -> list[Call]:
    """Return the calls that strace has noted, in their order."""
    found: list[tuple[float, Call]] = []
    for file in notes.iterdir():
        for line in file.read_text(encoding="ascii").splitlines():
            one = _LINE.match(line)
            if one is not None and int(one["result"]) >= 0:
                opened = _plain(one["path"] or "")
                call = Call(one["call"], one["arguments"], int(one["result"]), opened)
                found.append((float(one["time"]), call))
    return [call for _, call in sorted(found, key=lambda one: one[0])]


def _plain(text: str) -> str:
    return bytes(int(one, 16) for one in re.findall(r"\\x([0-9a-f]{2})", text)).decode()


@dataclass
class Replay:
    """Makes the changes of calls on a disk; `working` is the program's working directory."""

    disk: Disk
    working: Path
    _offsets: dict[tuple[str, str], int] = field(default_factory=dict)

    def changes(self, call: Call) -> bool:
        """Make a call's change; whether there is one below the disk's root."""
        if call.name in {"fsync", "fdatasync"}:
            self.disk.flush(call.files[0][1])
            return call.files[0][1] in self.disk.names
        if call.name in {"openat", "open", "creat"}:
            return self._open(call)
        if call.name in {"sendfile", "copy_file_range"}:
            return self._copy(call)
        if call.name in {"lseek", "ftruncate"} or "write" in call.name:
            return self._write(call)
        return self._rename(call)

    def _open(self, call: Call) -> bool:
        """Make or empty a file that is opened to be written."""
        path = call.opened or call.paths(self.working)[0]
        if not path.startswith(self.disk.root) or not re.search("O_WRONLY|O_RDWR", call.arguments):
            return False
        node = self.disk.names.get(path)
        at_end = isinstance(node, Node) and "O_APPEND" in call.arguments
        self._offsets[path, str(call.result)] = len(node.content) if at_end else 0  # type: ignore[union-attr]
        if not isinstance(node, Node):
            self.disk.change(Change("add", path, Node()))
            return True
        if "O_TRUNC" in call.arguments:
            node.content = b""
        return "O_TRUNC" in call.arguments

    def _write(self, call: Call) -> bool:
        """Write to a file, cut it, or move the place where the next write goes."""
        number, path = call.files[0]
        node = self.disk.names.get(path)
        if not isinstance(node, Node):
            return False
        if call.name == "lseek":
            self._offsets[path, number] = call.result
            return False
        if call.name == "ftruncate":
            node.content = node.content[: call.last].ljust(call.last, b"\0")
        elif call.name.startswith("pwrite"):
            node.write(call.last, b"".join(call.texts)[: call.result])
        else:
            self._append(node, path, number, b"".join(call.texts)[: call.result])
        return True

    def _copy(self, call: Call) -> bool:
        """Copy from one file to another within the system."""
        files = call.files if call.name == "sendfile" else call.files[::-1]
        (number, path), (_, source) = files
        node = self.disk.names.get(path)
        if not isinstance(node, Node) or call.result == 0:
            return False
        begin = self._offsets.get((path, number), 0)
        copied = self.disk.names.get(source)
        content = copied.content if isinstance(copied, Node) else Path(source).read_bytes()
        self._append(node, path, number, content[begin : begin + call.result])
        return True

    def _append(self, node: Node, path: str, number: str, data: bytes) -> None:
        """Write where the last write through a descriptor ended."""
        at = self._offsets.get((path, number), 0)
        node.write(at, data)
        self._offsets[path, number] = at + len(data)

    def _rename(self, call: Call) -> bool:
        """Change names."""
        paths = [self.disk.real(path) for path in call.paths(self.working)]
        if not any(path.startswith(self.disk.root) for path in paths):
            return False
        if call.name.startswith("mkdir"):
            self.disk.change(Change("add", paths[0], None))
        elif call.name.startswith("symlink"):
            self.disk.change(Change("add", paths[-1], call.texts[0].decode()))
        elif call.name.startswith("link"):
            self.disk.change(Change("add", paths[1], self.disk.names[paths[0]]))
        elif call.name.startswith("rename"):
            self.disk.change(Change("move", paths[0], target=paths[1]))
        else:
            self.disk.change(Change("remove", paths[0]))
        return True


def write_state(state: State, root: Path) -> None:
    """Write a disk's state to a folder."""
    shutil.rmtree(root, ignore_errors=True)
    for path, held in sorted(state.items()):
        place = Path(path)
        if held is None:
            place.mkdir(parents=True, exist_ok=True)
        elif isinstance(held, str):
            place.symlink_to(held)
        else:
            place.write_bytes(held)


def digest(state: State) -> str:
    """Return a hash of a state."""
    content = hashlib.sha256()
    for path, held in sorted(state.items()):
        content.update(f"{path}\0{type(held).__name__}\0".encode())
        content.update(held.encode() if isinstance(held, str) else held or b"")
    return content.hexdigest()


def folder_of(state: State, link: str) -> State | None:
    """Return the content by name of the folder that a link leads to; None if there is none."""
    target = state.get(link)
    if not isinstance(target, str):
        return None
    folder = os.path.normpath(Path(link).parent / target)
    if folder not in state:
        return None
    below = f"{folder}/"
    return {path[len(below) :]: held for path, held in state.items() if path.startswith(below)}


SEED = 20_261_124
# Number of different states of the disk from which a next start is tried.
STARTS = int(os.environ.get("RENEW_POWER_CUTS", "25"))


class Cuts:
    """All states that a power cut may leave while a command writes to a folder with results."""

    def __init__(self, folder: Path, output: Path, link: str, command: Sequence[str]) -> None:
        self.output, self.link = output, str(output / link)
        rng = random.Random(SEED)  # noqa: S311 - a test's seed
        disk = Disk.of(output)
        self.old = folder_of(dict(disk.states(rng))["nothing lost"], self.link)
        traced(command, folder, folder / "notes")
        real = dict(Disk.of(output).states(rng))["nothing lost"]
        self.new = folder_of(real, self.link)
        assert self.old is not None
        assert self.new is not None
        assert self.new != self.old
        self.met: Counter[str] = Counter()
        self.calls = 0
        self.different: dict[str, State] = {}
        replay = Replay(disk, folder)
        for call in calls_in(folder / "notes"):
            if replay.changes(call):
                self.calls += 1
                for lost, state in disk.states(rng):
                    self._look(call, lost, state)
        # The model is right: nothing was written that it has not seen.
        modelled = dict(disk.states(rng))
        assert modelled["nothing lost"] == real
        # Once a program has reported that it published something, that stays published.
        for lost, state in modelled.items():
            assert folder_of(state, self.link) == self.new, lost

    def _look(self, call: Call, lost: str, state: State) -> None:
        """Check that what is published is whole, the old or the new."""
        published = folder_of(state, self.link)
        assert published in (self.old, self.new), (call, lost, _difference(published, self.new))
        self.met["old" if published == self.old else "new"] += 1
        self.different[digest(state)] = state

    @property
    def summary(self) -> str:
        """What was tried."""
        states = sum(self.met.values())
        return f"{self.calls} calls, {states} states, {len(self.different)} different, {self.met}"

    def start_again(self, again: Callable[[], None]) -> int:
        """Start the program on some of the states; return their number."""
        rng = random.Random(SEED)  # noqa: S311 - a test's seed
        chosen = rng.sample(sorted(self.different), min(STARTS, len(self.different)))
        for number, key in enumerate(chosen):
            write_state(self.different[key], self.output)
            print(f"start {number + 1} of {len(chosen)}", flush=True)  # noqa: T201 - it takes long
            again()
        return len(chosen)


def _difference(published: State | None, new: State | None) -> object:
    """Say how what is published differs from what is to be."""
    if published is None or new is None:
        return "nothing is published"
    return [name for name in {*published, *new} if published.get(name) != new.get(name)]
