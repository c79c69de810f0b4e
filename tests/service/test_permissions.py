# SPDX-License-Identifier: Apache-2.0
"""Files and directories that the service may not use: the message names owner, group and mode, and the command that permits it."""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

import pytest

from service import PATIENCE_S

AS_USER = """import os, sys
os.setgroups([])
os.setgid(60003)
os.setuid(60003)
os.execve(sys.argv[1], sys.argv[1:], os.environ)
"""
END = ("--page_origins", "wrong")  # a fault that is found after those of the tests: no start succeeds


@pytest.fixture
def start_as_user(build):
    """Starts hexad as the user 60003 in a directory that every user can enter; returns its messages before it ends with an error."""
    if os.geteuid() != 0:
        pytest.skip("only root can be other users")
    with tempfile.TemporaryDirectory() as path:
        place = pathlib.Path(path)
        place.chmod(0o755)
        shutil.copy(build / "hexad", place / "hexad")
        shutil.copy(build / "hexad-worker", place / "hexad-worker")
        state = place / "state"
        state.mkdir(mode=0o700)
        os.chown(state, 60003, 60003)

        def start(*words, state=state):
            done = subprocess.run([sys.executable, "-c", AS_USER, place / "hexad", "--state_dir", state, *END, *words], stdin=subprocess.DEVNULL,
                                  capture_output=True, text=True, timeout=PATIENCE_S)
            assert done.returncode in (1, 2), done.stderr
            return done.stderr

        start.place = place
        yield start


def run_as_user(start, *words, state="state", statuses=(1, 2)):
    """The messages without the fault of END."""
    done = subprocess.run([sys.executable, "-c", AS_USER, start.place / "hexad", "--state_dir", start.place / state, *words],
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S)
    assert done.returncode in statuses, done.stdout
    return done.stdout


ROOTS = "has the owner root, the group root and the mode"


def test_a_state_directory_of_another_user_is_named_with_the_command_that_corrects_it(start_as_user):
    place = start_as_user.place
    other = place / "other"
    other.mkdir(mode=0o700)
    assert f"{other} {ROOTS} 0700, and it must belong to the user 60003. Run as root: chown -R 60003:60003 {other}" in start_as_user(state=other)
    assert f"{place} {ROOTS} 0755, and the user 60003 must be able to write to it. Run as root: install -d -o 60003 -g 60003 -m 0700 " \
        f"{place}/new" in start_as_user(state=place / "new")
    assert f"{other} {ROOTS} 0700, and the user 60003 must be able to enter it. Run as root: chmod o+x {other}" in \
        start_as_user(state=other / "state")
    for words, status in ((), 0), (("--strict",), 1):
        told = run_as_user(start_as_user, "--check-settings", *words, state="other", statuses=(status,))
        assert f"hexad would not start: state_dir: cannot write to {other}: Permission denied: {other} {ROOTS} 0700" in told
    run_as_user(start_as_user, "--check-settings", "--strict", statuses=(0,))
    (place / "state/lock").touch(mode=0o600)
    assert f"{place}/state/lock {ROOTS} 0600, and it must belong to the user 60003" in start_as_user()


READ_ONLY = """
mount -t tmpfs -o ro none "$1" || exit 77
shift
exec "$@"
"""


def test_a_missing_directory_on_a_read_only_file_system_is_created_before_its_unit_permits_it(build, tmp_path):
    """With ReadWritePaths= of a missing directory, a unit of systemd cannot start."""
    disk = tmp_path / "disk"
    disk.mkdir()
    under = ["unshare", "-m", "sh", "-c", READ_ONLY, "sh", disk]
    if not shutil.which("unshare") or subprocess.run([*under, "true"], capture_output=True).returncode:
        pytest.skip("mounting needs root")

    def check(state):
        return subprocess.run([*under, build / "hexad", "--check-settings", "--state_dir", state], capture_output=True, text=True,
                              timeout=PATIENCE_S).stdout

    told = check(disk / "a/state")
    assert "Read-only file system" in told and told.index("install -d -o ") < told.index(f" {disk}/a/state` as root") < \
        told.index(f"ReadWritePaths={disk}/a/state,"), told
    assert f"ReadWritePaths={disk}," in check(disk) and "install" not in check(disk)


def test_a_directory_of_a_socket_is_created_only_if_it_is_missing(build, tmp_path):
    (tmp_path / "file").touch()
    for directory, created in (("none", True), ("file/below", False)):
        done = subprocess.run([build / "hexad", "--check-settings", "--state_dir", tmp_path / "state", "--listen",
                               f"unix:{tmp_path}/{directory}/x"], capture_output=True, text=True, timeout=PATIENCE_S)
        assert f"the directory {tmp_path}/{directory}: " in done.stdout and "choose another path" in done.stdout, done.stdout
        assert ("create it" in done.stdout) == created, done.stdout


def test_files_that_the_service_cannot_read_are_named_with_the_command_that_permits_it(start_as_user):
    """The token file, the key of sessions, the secret of webhooks and the settings."""
    file = start_as_user.place / "file"
    file.touch(mode=0o600)
    command = f"{file} {ROOTS} 0600, and no user except root and 60003 may read it. Run as root: chown root:60003 {file} && chmod 640 {file}"
    assert command in start_as_user("--token_file", file)
    assert command in start_as_user("--webhook_hosts", "example.org", "--webhook_secret_file", file)
    settings = f"{file} {ROOTS} 0600, and the user 60003 must be able to read it. Run as root: chmod o+r {file}"
    assert settings in start_as_user("--config", file)
    file.chmod(0o644)
    assert f"other users can access the file: {file} {ROOTS} 0644" in start_as_user("--token_file", file)
    key = start_as_user.place / "state/session.key"
    os.chown(key, 0, 0)
    assert f"{key} {ROOTS} 0600, and it must belong to the user 60003. Run as root: chown -R 60003:60003 {key}" in start_as_user()


def test_a_database_and_a_socket_that_are_denied_are_named_with_the_command_that_permits_them(start_as_user):
    """As after a restored copy of root, and for a socket in a directory of root."""
    database = start_as_user.place / "state/queue.db"
    database.touch(mode=0o600)
    place = start_as_user.place / "closed"
    place.mkdir(mode=0o755)
    told = run_as_user(start_as_user, "--listen", f"unix:{start_as_user.place}/state/socket")
    assert f"it cannot be opened: Permission denied: {database} {ROOTS} 0600, and it must belong to the user 60003. Run as root: " \
        f"chown -R 60003:60003 {database}" in told, told
    os.chown(database, 60003, 60003)
    told = run_as_user(start_as_user, "--listen", f"unix:{place}/socket")
    assert f"listen unix:{place}/socket: Permission denied: the user 60003 cannot create a socket in {place}: " in told, told
    assert "install -d -o 60003 DIRECTORY" in told


def log_of_unwritable_storage(start_as_user):
    """The line of a started daemon about a directory that it cannot write to."""
    program = [sys.executable, "-c", AS_USER, start_as_user.place / "hexad", "--state_dir", start_as_user.place / "state"]
    with subprocess.Popen(program, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            line = next(line for line in process.stderr if "cannot write to" in line)
        finally:
            process.terminate()
            process.communicate(timeout=PATIENCE_S)
    return line


def test_a_directory_of_results_that_is_denied_is_in_the_log_with_the_command_that_permits_it(start_as_user):
    results = start_as_user.place / "state/results"
    results.mkdir(mode=0o755)
    line = log_of_unwritable_storage(start_as_user)
    assert f"results: Permission denied: {results} {ROOTS} 0755, and it must belong to the user 60003. Run as root: " \
        f"chown -R 60003:60003 {results}" in line


def test_a_check_of_settings_finds_directories_that_deny_what_a_start_needs(start_as_user):
    place = start_as_user.place
    closed = place / "closed"
    closed.mkdir(mode=0o755)
    for word, value, message in (
            ("--work_dir", closed, f"work_dir: cannot write to {closed}: Permission denied: {closed} {ROOTS} 0755, and it must belong to the user 60003"),
            ("--work_dir", closed / "a/b", f"work_dir: cannot write to {closed}/a/b: Permission denied: {closed} {ROOTS} 0755, and the user 60003 must"),
            ("--port_file", closed / "port", f"port_file: cannot create {closed}/port: the directory {closed}: Permission denied: choose a directory"),
            ("--listen", f"unix:{closed}/socket", f"listen unix:{closed}/socket: Permission denied: the user 60003 cannot create a socket in {closed}:")):
        told = run_as_user(start_as_user, "--check-settings", "--strict", word, value, statuses=(1,))
        assert f"hexad would not start: {message}" in told, told
        assert message in run_as_user(start_as_user, word, value)


OWN = "has the owner 60003, the group 60003 and the mode"


def test_a_directory_of_the_service_with_a_wrong_mode_keeps_its_owner(start_as_user):
    place = start_as_user.place
    results, state = place / "state/results", place / "state"
    results.mkdir()
    os.chown(results, 60003, 60003)
    results.chmod(0o500)
    assert f"{results} {OWN} 0500, and the user 60003 must be able to write to it. Run: chmod u+w {results}" in log_of_unwritable_storage(start_as_user)
    results.chmod(0o700)
    key = state / "session.key"  # of the start above
    key.chmod(0)
    assert f"{key} {OWN} 0000, and the user 60003 must be able to write to it. Run: chmod u+rw {key}" in start_as_user()
    key.chmod(0o600)
    state.chmod(0o300)
    assert f"{state} {OWN} 0300, and the user 60003 must be able to write to it. Run: chmod u+r {state}" in start_as_user()
    state.chmod(0o700)
    roots = place / "roots"
    (roots / "below").mkdir(parents=True)
    os.chown(roots, 60003, 60003)
    roots.chmod(0o600)
    assert f"must be able to enter it. Run: chmod u+x {roots}" in start_as_user("--input_roots", roots / "below")
    for word, missing in ("--output_roots", "rwx"), ("--input_roots", "r"):
        roots.chmod(0o000 if missing == "rwx" else 0o300)
        assert f"Run: chmod u+{missing} {roots}" in start_as_user(word, roots), word


def test_a_user_who_is_not_that_of_the_service_is_told_to_run_the_command_as_that_user(start_as_user):
    """The commands that give the directory to this user would take it from the service."""
    other = start_as_user.place / "other"
    other.mkdir()
    os.chown(other, 60005, 60005)
    other.chmod(0o700)
    for words in ("--backup", other / "copy"), ("--backup", start_as_user.place / "copy"), ("--check",):
        told = run_as_user(start_as_user, *words, state="other", statuses=(1,))
        assert f"{other} belongs to the user 60005: run this command as root or as this user" in told, told
        assert "chmod" not in told and "chown" not in told
    told = start_as_user(state=other)
    assert f"Run this command as the user 60005. If the user 60003 is the user of the service, run as root: chown -R 60003:60003 {other}" in told
    assert "Run this command as root or as the user 60005" in start_as_user(state=other / "below")


def test_files_in_a_closed_directory_of_root_are_moved(start_as_user):
    closed = start_as_user.place / "closed"
    closed.mkdir()
    (closed / "hexad.conf").touch()
    for mode in 0o700, 0o000:
        closed.chmod(mode)
        told = start_as_user("--config", closed / "hexad.conf")
        assert "Move the file to /etc, or to another directory that the user 60003 can enter" in told and "chmod" not in told
    told = start_as_user("--input_roots", "/root/below")
    assert "Move what is needed from the home directory of root" in told and "chmod" not in told


def test_roots_that_the_service_cannot_use_are_named_with_the_command_that_permits_it(start_as_user):
    place = start_as_user.place
    closed = place / "closed"
    (closed / "below").mkdir(parents=True)
    closed.chmod(0o700)
    assert f"{closed} {ROOTS} 0700, and the user 60003 must be able to enter it. Run as root: chmod o+x {closed}" in \
        start_as_user("--input_roots", closed / "below")
    closed.chmod(0o711)
    told = start_as_user("--input_roots", closed)
    assert f"warning input_roots: cannot read {closed}: Permission denied: {closed} {ROOTS} 0711, and the user 60003 must be able to read it. " \
        f"Run as root: chmod o+rx {closed}" in told
    out = place / "out"
    out.mkdir(mode=0o755)
    told = start_as_user("--output_roots", out)
    assert "warning cannot copy results below this output root" in told
    assert f"{out} {ROOTS} 0755, and the user 60003 must be able to write to it. Run as root: chgrp 60003 {out} && chmod g+rwx {out}" in told
    denied = f"{out} {ROOTS} 0755, and the user 60003 must be able to write to it"
    assert denied in start_as_user("--output_roots", f"{out}/%u") \
        and denied in run_as_user(start_as_user, "--output_roots", f"{out}/%u", "--check-settings", statuses=(0,))
    (out / "alice").mkdir()  # prepared by the administrator
    assert denied not in start_as_user("--output_roots", f"{out}/%u")
    subprocess.run(f"chgrp 60003 {out} && chmod g+rwx {out} && chmod o+rx {closed}", shell=True, check=True)
    assert "warning" not in start_as_user("--output_roots", out, "--input_roots", closed)


def test_hexadctl_tells_a_user_who_may_not_use_the_token_file_to_run_the_command_with_sudo(start_as_user, build):
    """The commands for a service that is denied access would take the file from the service."""
    place = start_as_user.place
    shutil.copy(build / "hexadctl", place / "hexadctl")
    tokens = place / "tokens"

    def say(*words):
        done = subprocess.run([sys.executable, "-c", AS_USER, place / "hexadctl", "token", *words, "--file", tokens], stdin=subprocess.DEVNULL,
                              capture_output=True, text=True, timeout=PATIENCE_S)
        return done.returncode, done.stderr

    denied = (2, f"hexadctl: {tokens}: access to the token file is denied. Run the same command with sudo.\n")
    assert say("add", "alice") == denied  # root has made the directory
    subprocess.run([build / "hexadctl", "token", "add", "alice", "--file", tokens], check=True, capture_output=True)
    for mode in (0o600, 0o644):
        tokens.chmod(mode)
        for words in (("list",), ("add", "alice"), ("revoke", "0")):
            assert say(*words) == denied, (oct(mode), words)
    done = subprocess.run([build / "hexadctl", "token", "list", "--file", tokens], capture_output=True, text=True)
    assert f"Run: chmod 640 {tokens}" in done.stderr, "with 600 a service of another user could not read it"


def test_root_administers_the_token_file_of_another_user_who_keeps_it(start_as_user, build):
    """A daemon without systemd runs as a user, who made the file."""
    tokens = start_as_user.place / "state/tokens"

    def control(*words):
        return subprocess.run([build / "hexadctl", "token", *words, "--file", tokens], stdin=subprocess.DEVNULL, capture_output=True,
                              text=True, timeout=PATIENCE_S)

    def access():
        info = tokens.stat()
        return info.st_uid, info.st_gid, info.st_mode & 0o777

    tokens.touch(mode=0o600)
    os.chown(tokens, 60003, 60004)
    assert control("list").returncode == 0
    for words in (("add", "alice"), ("add", "bob"), ("revoke", "0")):
        done = control(*words)
        assert done.returncode == (4 if words[1] == "0" else 0), done.stderr
        assert access() == (60003, 60004, 0o600)
    shown = control("list").stdout
    token = next(line.split()[0] for line in shown.splitlines() if " alice " in line)
    assert control("revoke", token).returncode == 0 and access() == (60003, 60004, 0o600)
    assert "belongs to another user" not in start_as_user("--token_file", tokens)
    tokens.chmod(0o644)
    done = control("list")
    assert done.returncode == 2 and f"Run as root: chmod 600 {tokens}\n" in done.stderr, done.stderr
    done = control("add", "carol", "--file", start_as_user.place / "nowhere/tokens")
    assert done.returncode == 2 and "sudo" not in done.stderr, done.stderr
