# SPDX-License-Identifier: Apache-2.0
"""A model of a disk: what a power loss may leave of a directory, from a record of all changes in it.

Of a file what was written before an fsync that came back is there; what came later is there or not, for each page of
4 KiB apart, and a page may be torn between sectors. Of a directory the names that its fsync found are there; later
changes are there or not, a rename as a whole. That is less than any file system in use promises, but for one thing:
names of files come with nothing but the fsync of their directory. Modes are not modelled: files are their owner's alone.

The record is a list of tuples, paths relative to the directory:
    ("create", path) ("mkdir", path) ("remove", path) ("rename", path, path) ("link", path, path)
    ("write", path, offset, bytes) ("truncate", path, size)
    ("sync", path, token) ("synced", token): an fsync, when it was called and when it came back
    ("unsynced", path): an fsync of a file that failed. What waited for it may be lost although a later one succeeds
and any other, which is passed over.
"""
import os
import pathlib
import random

PAGE, SECTOR = 4096, 512
# what becomes of what was not synced
LOSSES = ("nothing is left", "all is left", "any of it is left", "names are left in order")


class File:
    def __init__(self, content=b""):
        self.live, self.durable, self.pending = bytearray(content), bytearray(content), []
        self.forsaken = []


class Directory:
    def __init__(self):
        self.live, self.durable, self.pending = {}, {}, []


def change_file(content, change):
    _, _, offset, data = change
    if data is None:  # truncated
        del content[offset:]
        content.extend(bytes(offset - len(content)))
    else:
        content.extend(bytes(max(0, offset - len(content))))
        content[offset:offset + len(data)] = data


def overlap(one, other):
    (_, _, a, first), (_, _, b, second) = one, other
    return first is None or second is None or a < b + len(second) and b < a + len(first)


def change_names(entries, change):
    for name, node in change[2]:
        if node is None:
            entries.pop(name, None)
        else:
            entries[name] = node


class Disk:
    """`deaf(path)`: whether an fsync of that path does nothing, to see that it matters."""

    def __init__(self, deaf=lambda path: False):
        self.root, self.deaf, self.now, self.syncs = Directory(), deaf, 0, {}

    def load(self, where, into=None, files=None):
        """Takes a directory as it is for durable; a file with two names is one file."""
        into, files = into or self.root, {} if files is None else files
        for path in pathlib.Path(where).iterdir():
            node = Directory() if path.is_dir() else files.setdefault(path.stat().st_ino, File(path.read_bytes()))
            into.live[path.name] = into.durable[path.name] = node
            if path.is_dir():
                self.load(path, node, files)

    def find(self, path):
        node = self.root
        for name in path.split("/"):
            if name != "." and node is not None:
                node = node.live.get(name) if isinstance(node, Directory) else None
        return node

    def parent(self, path):
        return self.find(os.path.dirname(path) or "."), os.path.basename(path)

    def name(self, *changes):
        """Changes of names that happen together: (directory, name, node or None)."""
        self.now += 1
        for directory in {id(d): d for d, _, _ in changes}.values():
            change = (self.now, directory, [(name, node) for d, name, node in changes if d is directory])
            change_names(directory.live, change)
            directory.pending.append(change)

    def write(self, path, offset, data):
        node = self.find(path)
        if not isinstance(node, File):
            return  # removed while it was open
        self.now += 1
        change = (self.now, node, offset, data)
        change_file(node.live, change)
        node.pending.append(change)

    def apply(self, entry):
        kind, rest = entry[0], entry[1:]
        if kind in ("create", "mkdir"):
            directory, name = self.parent(*rest)
            if isinstance(directory, Directory) and name not in directory.live and name != ".":
                self.name((directory, name, File() if kind == "create" else Directory()))
        elif kind == "remove":
            directory, name = self.parent(*rest)
            node = self.find(*rest)
            if node and not (isinstance(node, Directory) and node.live):
                self.name((directory, name, None))
        elif kind in ("rename", "link"):
            node, (source, old), (target, new) = self.find(rest[0]), self.parent(rest[0]), self.parent(rest[1])
            if node and isinstance(target, Directory):
                gone = [(source, old, None)] if kind == "rename" else []
                self.name(*gone, (target, new, node))
        elif kind == "write":
            self.write(*rest)
        elif kind == "truncate":
            self.write(rest[0], rest[1], None)
        elif kind == "sync":
            self.syncs[rest[1]] = (None if self.deaf(rest[0]) else self.find(rest[0]), self.now)
        elif kind == "unsynced":
            self.forsake(self.find(rest[0]))
        elif kind == "synced":
            self.sync(*self.syncs.pop(rest[0]))

    def forsake(self, node):
        """The kernel holds pages that it could not write for clean: no later fsync writes them."""
        if isinstance(node, File):
            node.forsaken += node.pending
            node.pending = []

    def sync(self, node, until):
        if node is None:
            return
        change_one = change_file if isinstance(node, File) else change_names
        for change in [c for c in node.pending if c[0] <= until]:
            change_one(node.durable, change)
            node.pending.remove(change)
            if isinstance(node, Directory):
                self.finish_rename(node, change)
            else:
                node.forsaken = [old for old in node.forsaken if not overlap(old, change)]

    def finish_rename(self, node, change):
        """A rename is durable in both directories or in none."""
        for other in self.directories():
            for twin in [c for c in other.pending if c[0] == change[0] and other is not node]:
                change_names(other.durable, twin)
                other.pending.remove(twin)

    def directories(self):
        """Also those that only the durable part still knows."""
        found, waiting = {}, [self.root]
        while waiting:
            node = waiting.pop()
            if isinstance(node, Directory) and id(node) not in found:
                found[id(node)] = node
                waiting += [*node.live.values(), *node.durable.values()]
                waiting += [n for change in node.pending for _, n in change[2] if n]
        return list(found.values())

    def compare(self, where):
        """The paths at which a directory and the model of it differ."""
        def tree(directory, base):
            for name, node in directory.live.items():
                yield base + name, bytes(node.live) if isinstance(node, File) else None
                if isinstance(node, Directory):
                    yield from tree(node, f"{base}{name}/")
        ours, root = dict(tree(self.root, "")), pathlib.Path(where)
        theirs = {str(p.relative_to(root)): None if p.is_dir() else p.read_bytes() for p in root.rglob("*")}
        return sorted(path for path in ours.keys() | theirs.keys()
                      if path not in ours or path not in theirs or ours[path] != theirs[path])

    def lose_power(self, where, loss, seed):
        """Makes the directory `where` what a power loss now may leave."""
        rng = random.Random(seed)
        waiting = sorted({change[0] for directory in self.directories() for change in directory.pending})
        cut = rng.randrange(len(waiting) + 1)
        left = {LOSSES[0]: set(), LOSSES[1]: set(waiting), LOSSES[2]: {n for n in waiting if rng.random() < 0.5},
                LOSSES[3]: set(waiting[:cut])}[loss]
        self.rebuild(self.root, pathlib.Path(where), left, loss, rng, {})

    def rebuild(self, directory, where, left, loss, rng, files):
        where.mkdir()
        entries = dict(directory.durable)
        for change in directory.pending:
            if change[0] in left:
                change_names(entries, change)
        for name, node in entries.items():
            if isinstance(node, Directory):
                self.rebuild(node, where / name, left, loss, rng, files)
            elif id(node) in files:
                os.link(files[id(node)], where / name)
            else:
                files[id(node)] = where / name
                (where / name).write_bytes(rebuild_file(node, loss, rng))
                (where / name).chmod(0o600)


def rebuild_file(node, loss, rng):
    content = bytearray(node.durable)
    for number, owner, offset, data in node.forsaken + node.pending:
        if loss == LOSSES[0] or data is None and loss != LOSSES[1] and rng.random() < 0.5:
            continue
        if loss == LOSSES[1] or data is None:
            change_file(content, (number, owner, offset, data))
            continue
        for begin in range(offset - offset % PAGE, offset + len(data), PAGE):
            first, last = max(begin, offset), min(begin + PAGE, offset + len(data))
            if rng.random() < 0.5:
                continue
            if rng.random() < 0.125:  # torn
                last = min(last, begin + SECTOR * rng.randrange(PAGE // SECTOR))
            if first < last:
                change_file(content, (number, owner, first, data[first - offset:last - offset]))
    return content
