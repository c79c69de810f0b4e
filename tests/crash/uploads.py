# SPDX-License-Identifier: Apache-2.0
"""Uploads of a client: what it was told of them, and what a daemon must know after a kill or with an older database."""
import hashlib
import http.client
import threading
import zlib

from farm import Violation

TETRAHEDRON = "OFF\n4 4 0\n{0} {0} {0}\n{0} -{0} -{0}\n-{0} {0} -{0}\n-{0} -{0} {0}\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def hash_of(text):
    return hashlib.sha256(text.encode()).hexdigest()


class Uploads:
    """Thread-safe. The files that the client holds, with their names. Those of which an answer did not arrive are doubtful: held or not,
    by the new name or the old one."""

    def __init__(self, reads=False):
        """`reads`: some jobs read a file that is deleted before they end."""
        self.reads, self.mutex = reads, threading.Lock()
        self.texts, self.held, self.doubtful, self.own = {}, {}, set(), []
        self.figures = {"uploads sent": 0, "uploads deleted": 0}

    def ask(self, daemon, method, hash, body=None, query=""):
        try:
            return daemon.request(method, f"/v1/inputs/{hash}{query}", body)
        except (OSError, http.client.HTTPException):
            return None

    def change(self, daemon, book, hash, method, name=None):
        """Sends or deletes a file; True when that was acknowledged."""
        with self.mutex:
            was_held = hash in self.held and hash not in self.doubtful
            self.doubtful.add(hash)
        sent = method == "PUT"
        reply = self.ask(daemon, method, hash, self.texts[hash] if sent else None, f"?name={name}" if name else "")
        if book.is_no_answer(reply):
            return False
        if reply.status not in ((200, 201) if sent else (204,) if was_held else (204, 404)):
            raise Violation(f"{method} of the upload {hash} is answered with {reply.status} {reply.body!r}")
        with self.mutex:
            self.doubtful.discard(hash)
            if sent:
                self.held[hash] = name
            else:
                self.held.pop(hash, None)
            self.figures["uploads sent" if sent else "uploads deleted"] += 1
        return True

    def send(self, daemon, book, text, name):
        """The hash when the file was acknowledged; otherwise None."""
        hash = hash_of(text)
        with self.mutex:
            self.texts[hash] = text
        return hash if self.change(daemon, book, hash, "PUT", name) else None

    def act(self, daemon, book, text, rng):
        """Sends a file, names one anew, or deletes one."""
        kind = rng.random()
        if self.own and kind < 0.3:
            self.change(daemon, book, self.own.pop(rng.randrange(len(self.own))), "DELETE")
        elif self.own and kind < 0.5:
            self.change(daemon, book, rng.choice(self.own), "PUT", text)
        else:
            self.own.append(hash_of(text))
            self.send(daemon, book, text, rng.choice((None, "a.obj")))

    def be_read(self, daemon, book, document, rng):
        """Has a new job read a file of its own; the hash of the file, or None."""
        if not self.reads or rng.random() > 0.1 or "analytic" not in document["surface"] or document["name"] in book.sent:
            return None
        sent = self.send(daemon, book, TETRAHEDRON.format(1 + zlib.crc32(document["name"].encode())), document["name"])
        if sent:
            document["surface"] = {"mesh": {"path": f"sha256:{sent}.off"}}
        return sent

    def listed(self, daemon):
        """hash -> name of all files that the daemon lists."""
        found, cursor = {}, ""
        while cursor is not None:
            reply = daemon.ask("GET", f"/v1/inputs?limit=20{cursor and '&cursor='}{cursor}")
            if reply is None or reply.status != 200:
                raise Violation(f"uploads are not listed: {reply and reply.body!r}")
            for file in reply.json["inputs"]:
                if file["sha256"] in found:
                    raise Violation(f"the upload {file['sha256']} is listed twice")
                found[file["sha256"]] = file["name"]
            cursor = reply.json["next"]
        return found

    def check(self, daemon):
        """While no client sends: the list is what was acknowledged, and counts and files agree with it."""
        found = self.listed(daemon)
        for hash in self.doubtful:
            self.held.pop(hash, None)
            if hash in found:
                self.held[hash] = found[hash]
        self.doubtful.clear()
        if found != self.held:
            raise Violation(f"uploads are listed as {found} and were acknowledged as {self.held}")
        self.check_files(daemon, found)
        sizes = [len(self.texts[hash]) for hash in found]
        usage = daemon.ask("GET", "/v1/usage").json
        counted = [user["upload_bytes"] for user in usage["users"] if user["upload_bytes"]]
        if counted != [sum(sizes)] * bool(sizes):
            raise Violation(f"uploads of {sum(sizes)} bytes count as {counted}")
        stored = sum(path.stat().st_size for path in (daemon.state / "inputs").glob("sha256:*"))
        if usage["all"]["upload_bytes"] != stored:
            raise Violation(f"stored uploads of {stored} bytes count as {usage['all']['upload_bytes']}")

    def check_files(self, daemon, hashes):
        for hash in hashes:
            path = daemon.state / "inputs" / f"sha256:{hash}"
            if not path.is_file() or path.read_text() != self.texts[hash]:
                raise Violation(f"the upload {hash} is gone or changed")

    def send_again(self, daemon, book):
        """With an older database, or without the old one: the files are kept, and held by the client that sends their bytes again."""
        self.check_files(daemon, self.held.keys() - self.doubtful)
        for hash in self.listed(daemon).keys() - self.held.keys():  # deleted since
            self.change(daemon, book, hash, "DELETE")
        for hash, name in list(self.held.items()):
            if not self.change(daemon, book, hash, "PUT", name):
                raise Violation(f"the upload {hash} cannot be sent again")
        self.check(daemon)
