# SPDX-License-Identifier: Apache-2.0
"""hexad --allow and --deny: the settings file and the drop-in that they write, and who may connect afterwards."""
import grp
import os
import pwd
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import time

import pytest

from service import PATIENCE_S, wait_until

# An external program. It shows properties of units from files. It logs other arguments, and fails with a message if the
# file `fails` has the first one as a line. A start sets the time since which the socket has been active.
SYSTEMCTL = """#!/bin/sh
cd "$(dirname "$0")"
[ "$1" != show ] || exec cat "$4"
echo "$@" >>calls
! grep -qsx -e "$1" fails || { echo "Failed to $1: the bus is away" >&2; exit 1; }
[ "$1" != start ] || date +@%s >ActiveEnterTimestamp
"""
BOTH = ["try-reload-or-restart hexad.service", "daemon-reload"]
HERE = pwd.getpwuid(os.geteuid()).pw_name
GROUP = grp.getgrgid(os.getegid()).gr_name
# Runs a program as another user, who may be unable to enter the directory of the program.
ASK_AS = """import os, sys
program = os.open(sys.argv[1], os.O_RDONLY)
os.setgroups([])
os.setgid(60003)
os.setuid(60003)
os.execve(program, sys.argv[1:], os.environ)
"""


class Host:
    """What `hexad --allow` finds of a host, below a directory of the test."""

    def __init__(self, build, root, settings="workers = 2\n"):
        self.build, self.root = build, root
        self.file = root / "hexad.conf"
        self.file.write_text(settings)
        self.file.chmod(0o644)
        self.units = root / "units"
        self.drop_in = self.units / "hexad.socket.d/allow.conf"
        (root / "bin").mkdir()
        (root / "bin/systemctl").write_text(SYSTEMCTL)
        (root / "bin/systemctl").chmod(0o755)
        (root / "bin/ExecStart").write_text(
            f"{{ path={build}/hexad ; argv[]={build}/hexad --config {self.file} ; ignore_errors=no ; pid=0 }}\n")
        (root / "bin/Listen").write_text(f"{root}/hexad.sock (Stream)\n")
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.bind(str(root / "hexad.sock"))
        (root / "hexad.sock").chmod(0o660)

    def hexad(self, *words, config=None):
        """With the settings file, unless other words take its place."""
        config = ("--config", self.file) if config is None else config
        environment = {**os.environ, "PATH": f"{self.root}/bin:{os.environ['PATH']}",
                       "SYSTEMD_UNIT_PATH": str(self.units), "RUNTIME_DIRECTORY": str(self.root)}
        return subprocess.run([self.build / "hexad", *config, *words], env=environment, text=True,
                              capture_output=True, timeout=PATIENCE_S)

    def expect(self, *words):
        done = self.hexad(*words)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def mode(self):
        return (self.root / "hexad.sock").stat().st_mode & 0o777

    def calls(self):
        """Of systemctl since the last look."""
        path = self.root / "bin/calls"
        text = path.read_text() if path.exists() else ""
        path.unlink(missing_ok=True)
        return text.splitlines()

    def files(self):
        return {str(p.relative_to(self.root)): p.read_bytes() for p in (self.file, *self.units.rglob("*")) if p.is_file()}


@pytest.fixture
def host(build, tmp_path):
    return Host(build, tmp_path)


def test_allow_writes_the_setting_and_the_drop_in_and_reloads_both(host):
    shown = host.expect("--allow", HERE)
    assert host.file.read_text() == f"workers = 2\nunix_users = {HERE}\n"
    assert host.file.stat().st_mode & 0o777 == 0o644
    assert "[Socket]\nSocketMode=0666\n" in host.drop_in.read_text()
    assert host.drop_in.stat().st_mode & 0o777 == 0o644 and host.drop_in.parent.stat().st_mode & 0o777 == 0o755
    assert host.mode() == 0o666
    assert host.calls() == BOTH
    for part in (str(host.file), str(host.drop_in), str(host.root / "hexad.sock"), f"unix_users = {HERE}", "daemon-reload"):
        assert part in shown, shown


def test_the_mode_of_the_settings_file_stays(host):
    host.file.chmod(0o640)
    host.expect("--allow", HERE)
    assert host.file.stat().st_mode & 0o777 == 0o640


def test_a_link_in_the_place_of_the_socket_is_not_followed(host):
    """The service's user owns its directory."""
    victim = host.root / "victim"
    victim.touch(0o600)
    (host.root / "hexad.sock").unlink()
    (host.root / "hexad.sock").symlink_to(victim)
    done = host.hexad("--allow", HERE)
    assert done.returncode == 1 and "hexad.sock is not a socket" in done.stderr
    assert victim.stat().st_mode & 0o777 == 0o600 and host.calls() == BOTH


def test_allow_can_be_repeated(host):
    host.expect("--allow", HERE)
    before, stamp = host.files(), host.file.stat().st_mtime_ns
    shown = host.expect("--allow", HERE)
    assert host.files() == before and host.file.stat().st_mtime_ns == stamp and "already" in shown


def test_a_group_is_allowed_by_its_name_after_an_at(host):
    host.expect("--allow", "@" + GROUP)
    assert host.file.read_text() == f"workers = 2\nunix_groups = {GROUP}\n"


@pytest.mark.sanitized
@pytest.mark.parametrize("settings", [
    "", "workers = 2", "workers = 2\n", "[hexad]\n# of the farm\n\n", "#unix_users =\n#unix_groups =\n\nworkers = 2\n",
    "unix_users = 61001\n   61002\nworkers = 2\n", "unix_users: 61001,61002\nunix-users = 61003"])
def test_deny_restores_the_files_byte_for_byte(build, tmp_path, settings):
    host = Host(build, tmp_path, settings)
    before, mode = host.files(), host.mode()
    host.expect("--allow", HERE)
    host.expect("--allow", "@" + GROUP)
    assert host.files() != before
    host.expect("--deny", "@" + GROUP)
    host.expect("--deny", HERE)
    after = host.files()
    if "61001" in settings:  # others may connect still
        assert after.pop("units/hexad.socket.d/allow.conf") and host.mode() == 0o666
    else:
        assert host.mode() == mode and not host.drop_in.parent.exists()
    assert after == before


def test_a_value_goes_behind_the_explanation_of_its_key(build, tmp_path):
    sample = subprocess.run([build / "hexad", "--print-config"], capture_output=True, text=True, check=True).stdout
    host = Host(build, tmp_path, sample)
    host.expect("--allow", HERE)
    assert host.file.read_text() == sample.replace("#unix_users =\n", f"#unix_users =\nunix_users = {HERE}\n")


def test_deny_takes_one_of_several_values_out_of_a_line(build, tmp_path):
    host = Host(build, tmp_path, "unix_users = 61001, 61002 ,61003\nworkers = 2\n")
    host.expect("--deny", "61002")
    assert host.file.read_text() == "unix_users = 61001,61003\nworkers = 2\n"
    host.expect("--deny", "61001")
    host.expect("--deny", "61003")
    assert host.file.read_text() == "workers = 2\n"


def test_deny_of_a_user_who_is_not_allowed_changes_nothing(host):
    before = host.files()
    assert "not in unix_users" in host.expect("--deny", HERE)
    assert host.files() == before


@pytest.mark.parametrize("word, name", [("nobody-by-this-name", "user nobody-by-this-name"), ("@no-such-group", "group no-such-group")])
@pytest.mark.parametrize("option", ["--allow", "--deny"])
def test_a_name_that_does_not_exist_is_refused(host, option, word, name):
    before = host.files()
    done = host.hexad(option, word)
    assert done.returncode == 2 and host.files() == before and host.calls() == []
    assert f"the {name} does not exist" in done.stderr and "getent" in done.stderr


def test_a_deleted_user_can_be_denied(build, tmp_path):
    host = Host(build, tmp_path, "unix_users = left-the-company\n")
    host.expect("--deny", "left-the-company")
    assert host.file.read_text() == ""


def test_a_deleted_user_does_not_hinder_other_changes(build, tmp_path):
    host = Host(build, tmp_path, f"unix_users = left-the-company, {HERE}\n")
    host.expect("--deny", HERE)
    assert host.file.read_text() == "unix_users = left-the-company\n"


def test_deny_warns_of_tokens_that_stay_valid(build, tmp_path):
    host = Host(build, tmp_path, f"unix_users = {HERE}\n")
    tokens = tmp_path / "tokens"
    for user in (HERE, HERE, "another"):
        subprocess.run([build / "hexadctl", "token", "add", user, "--file", tokens], check=True, capture_output=True)
    done = host.hexad("--token_file", tokens, "--deny", HERE)
    assert done.returncode == 0 and f"{HERE} still has 2 tokens in {tokens}" in done.stderr, done.stderr
    assert "hexadctl token revoke" in done.stderr


@pytest.mark.parametrize("settings, grant", [
    (f"unix_users = {HERE}, {os.geteuid()}\n", f"unix_users = {os.geteuid()}"),
    (f"unix_users = {HERE}\nunix_groups = {GROUP}\n", f"unix_groups = {GROUP}"),
    (f"unix_admins = {os.geteuid()}\n", f"unix_admins = {os.geteuid()}")])
def test_deny_warns_of_settings_that_still_admit_the_user(build, tmp_path, settings, grant):
    done = Host(build, tmp_path, settings).hexad("--deny", HERE)
    assert done.returncode == 0 and f"{HERE} is still admitted by {grant};" in done.stderr


def test_deny_warns_of_the_number_of_a_group(build, tmp_path):
    done = Host(build, tmp_path, f"unix_groups = {GROUP}, {os.getegid()}\n").hexad("--deny", "@" + GROUP)
    assert done.returncode == 0 and f"the group {GROUP} is still admitted by unix_groups = {os.getegid()};" in done.stderr


@pytest.mark.parametrize("word, number, line", [("", os.geteuid(), f"unix_users = {HERE}"),
                                                ("@", os.getegid(), f"unix_groups = {GROUP}")])
def test_a_number_is_allowed_and_denied_by_its_name(host, word, number, line):
    host.expect("--allow", f"{word}{number}")
    assert host.file.read_text() == f"workers = 2\n{line}\n"
    host.expect("--deny", f"{word}{number}")
    assert host.file.read_text() == "workers = 2\n"


def test_a_number_without_a_name_is_allowed_as_it_is(host):
    host.expect("--allow", "61004")
    assert host.file.read_text() == "workers = 2\nunix_users = 61004\n"


def test_a_number_in_the_file_can_be_denied(build, tmp_path):
    host = Host(build, tmp_path, f"workers = 2\nunix_users = {os.geteuid()}\n")
    host.expect("--deny", str(os.geteuid()))
    assert host.file.read_text() == "workers = 2\n"


def test_deny_warns_of_other_grants_although_systemctl_fails(build, tmp_path):
    host = Host(build, tmp_path, f"unix_users = {HERE}, {os.geteuid()}\n")
    (host.root / "bin/fails").write_text("try-reload-or-restart\n")
    done = host.hexad("--deny", HERE)
    assert done.returncode == 1 and f"{HERE} is still admitted by unix_users = {os.geteuid()};" in done.stderr


def test_deny_without_other_grants_does_not_warn(build, tmp_path):
    done = Host(build, tmp_path, f"unix_users = {HERE}, 61001\nunix_groups = 61002\n").hexad("--deny", HERE)
    assert done.returncode == 0 and done.stderr == ""


@pytest.mark.parametrize("words, both", [
    (("--allow", "a", "--deny", "b"), "--allow and --deny"), (("--backup", "f", "--allow", "x"), "--backup and --allow"),
    (("--check", "--deny", "x"), "--check and --deny"), (("--deny", "x", "--check"), "--check and --deny")])
def test_two_actions_are_refused(host, words, both):
    before = host.files()
    done = host.hexad(*words)
    assert done.returncode == 2 and f"{both} are both given: give one of them" in done.stderr and host.files() == before


def test_settings_that_hexad_refuses_are_not_written(build, tmp_path):
    host = Host(build, tmp_path, "wrokers = 2\n")
    done = host.hexad("--allow", HERE)
    assert done.returncode == 2 and "wrokers" in done.stderr and host.file.read_text() == "wrokers = 2\n"


def test_a_value_that_the_line_hides_is_to_be_removed_by_hand(build, tmp_path):
    """In a line of its own that goes on with the former one; no bytes of others change."""
    settings = "unix_users = 61001\n   61002\n"
    host = Host(build, tmp_path, settings)
    done = host.hexad("--deny", "61002")
    assert done.returncode == 2 and "61002 of unix_users is in a continuation line" in done.stderr
    assert "with an editor" in done.stderr and host.file.read_text() == settings


@pytest.mark.parametrize("verbs", [["daemon-reload"], ["try-reload-or-restart"], ["daemon-reload", "try-reload-or-restart"]])
def test_a_failing_systemctl_is_named_and_the_other_command_runs(host, verbs):
    (host.root / "bin/fails").write_text("".join(f"{verb}\n" for verb in verbs))
    done = host.hexad("--allow", HERE)
    assert done.returncode == 1 and host.drop_in.exists() and host.calls() == BOTH
    for command in BOTH:
        failed = command.split()[0] in verbs
        assert (f"`systemctl {command}`" in done.stderr) == failed, done.stderr
        assert (f"systemctl {command}: Failed to {command.split()[0]}: the bus is away\n" in done.stderr) == failed
    assert all(line.startswith(("systemctl ", "hexad: ")) for line in done.stderr.splitlines()), done.stderr
    if not os.path.isdir("/run/systemd/system"):  # as sd_booted(3) says
        assert f"{host.file} is written" in done.stderr and "kill -HUP PID" in done.stderr
    (host.root / "bin/fails").unlink()
    host.expect("--allow", HERE)


def test_deny_again_makes_systemd_notice_the_end_of_a_drop_in(host):
    """The reload of the run that removed it failed."""
    host.expect("--allow", HERE)
    (host.root / "bin/fails").write_text("daemon-reload\n")
    assert host.hexad("--deny", HERE).returncode == 1 and not host.drop_in.exists()
    (host.root / "bin/fails").unlink()
    (host.root / "bin/NeedDaemonReload").write_text("yes\n")
    host.calls()
    host.expect("--deny", HERE)
    assert host.calls() == BOTH


OPEN_PORT = ["daemon-reload", "stop hexad.service hexad.socket", "start hexad.socket hexad.service"]
OTHER = "daemon"  # a user of every Debian


def users_of(tokens):
    return [line.split()[1] for line in tokens.read_text().splitlines() if line[0] != "#"]


def test_open_port_serves_the_page_with_a_first_token(host, source):
    tokens, drop_in = host.root / "tokens", host.units / "hexad.socket.d/tcp.conf"
    shown = host.expect("--token_file", tokens, "--open-port", HERE)
    token = shown.splitlines()[0]
    assert token.startswith("hexad_") and f" {HERE} read,submit,cancel " in tokens.read_text()
    assert host.calls() == OPEN_PORT and drop_in.stat().st_mode & 0o777 == 0o644
    example = (source / "systemd/examples/tcp.conf").read_text()

    def settings(text):
        return [line for line in text.splitlines() if line and not line.startswith("#")]

    assert settings(drop_in.read_text()) == settings(example)
    assert all(f"systemctl {words}\n" in example for words in OPEN_PORT)
    assert "open http://127.0.0.1:8642/ in a browser of this machine" in shown
    drop_in.write_text(example.replace("8642", "9000"))  # an administrator's own
    for later, calls in ((0, OPEN_PORT[-1:]), (10, OPEN_PORT)):  # as old as the socket; systemd has not opened its port
        os.utime(drop_in, (drop_in.stat().st_mtime + later,) * 2)
        again = host.expect("--token_file", tokens, "--open-port", OTHER)
        assert "exists already" in again and "8642" not in again and "9000" in drop_in.read_text()
        assert host.calls() == calls and "open http://127.0.0.1:9000/ in a browser" in again
    assert users_of(tokens) == [HERE, OTHER]


def test_open_port_again_adds_no_token_and_starts_the_service(host):
    tokens = host.root / "tokens"
    host.expect("--token_file", tokens, "--open-port", HERE)
    host.calls()
    before = tokens.read_bytes()
    again = host.expect("--token_file", tokens, "--open-port", HERE)
    assert f"{HERE} has 1 token already" in again and "open http://127.0.0.1:8642/ in a browser" in again
    assert tokens.read_bytes() == before and host.calls() == OPEN_PORT[-1:]


@pytest.mark.parametrize("name", ["a b", "nosuchuser", "@" + GROUP])
def test_open_port_refuses_what_is_no_user(host, name):
    tokens = host.root / "tokens"
    done = host.hexad("--token_file", tokens, "--open-port", name)
    assert done.returncode == 2 and name in done.stderr and not done.stdout
    assert not (host.units / "hexad.socket.d").exists() and host.calls() == [] and not tokens.exists()


def test_open_port_names_a_command_that_fails(host):
    (host.root / "bin/fails").write_text("start\n")
    done = host.hexad("--token_file", host.root / "tokens", "--open-port", HERE)
    assert done.returncode == 1 and "`systemctl start hexad.socket hexad.service` failed" in done.stderr, done.stderr
    assert "`systemctl reset-failed hexad.service hexad.socket`" in done.stderr and host.calls() == OPEN_PORT


@pytest.mark.parametrize("fails", ["daemon-reload", "stop", "start"])
def test_open_port_after_a_failed_run_opens_the_port(host, fails):
    """systemd has not read the drop-in of the first run, or has not opened its port."""
    words = ("--token_file", host.root / "tokens", "--open-port", HERE)
    (host.root / "bin/ActiveEnterTimestamp").write_text(f"@{int(time.time()) - 10}\n")  # of the socket without the port
    (host.root / "bin/fails").write_text("".join(f"{verb}\n" for verb in (fails, "start")))
    assert host.hexad(*words).returncode == 1 and host.calls() == OPEN_PORT
    (host.root / "bin/fails").unlink()
    host.expect(*words)
    assert host.calls() == OPEN_PORT
    host.expect(*words)
    assert host.calls() == OPEN_PORT[-1:]


def test_open_port_makes_systemd_read_a_drop_in_that_it_has_not_read(host):
    """The reload failed, and the start did not."""
    words = ("--token_file", host.root / "tokens", "--open-port", HERE)
    (host.root / "bin/fails").write_text("daemon-reload\n")
    (host.root / "bin/NeedDaemonReload").write_text("yes\n")
    assert host.hexad(*words).returncode == 1 and host.calls() == OPEN_PORT
    (host.root / "bin/fails").unlink()
    host.expect(*words)
    assert host.calls() == OPEN_PORT


@pytest.mark.parametrize("systemd", ["has no unit", "does not answer"])
def test_open_port_without_the_unit_names_what_to_do_instead(host, systemd):
    if systemd == "has no unit":
        (host.root / "bin/ExecStart").write_text("\n")
    else:
        (host.root / "bin/systemctl").write_text("#!/bin/sh\necho System has not been booted with systemd >&2\nexit 1\n")
    for words, file in ((), "state/tokens"), (("--token_file", host.root / "own"), "own"):
        done = host.hexad("--state_dir", host.root / "state", *words, "--open-port", "alice")
        assert done.returncode == 2 and not done.stdout
        assert done.stderr == ("hexad: systemd does not run hexad: set listen = unix:,127.0.0.1:8642, run \"hexadctl token add alice --file "
                               f"{host.root}/{file}\", and start hexad again\n")
    assert not host.units.exists() and not (host.root / "own").exists() and host.calls() == []


@pytest.fixture
def other(host):
    """A service that systemd does not run."""
    (host.root / "bin/ExecStart").write_text("{ path=/usr/bin/hexad ; argv[]=/usr/bin/hexad --config /etc/hexad.conf ; }\n")
    return host


def test_a_user_who_is_not_root_reads_the_command_with_sudo(host, public_directory):
    def as_stranger(*words):
        environment = {**os.environ, "PATH": f"{host.root}/bin:{os.environ['PATH']}", "SYSTEMD_UNIT_PATH": f"{public_directory}/units"}
        return subprocess.run([sys.executable, "-c", ASK_AS, host.build / "hexad", *words], env=environment, capture_output=True,
                              text=True, timeout=PATIENCE_S)

    file = f"{public_directory}/hexad.conf"
    with open(file, "w") as settings:
        settings.write("workers = 2\n")
    told = as_stranger("--config", file, "--allow", HERE)
    assert told.returncode == 1 and told.stderr.endswith(f". Run as root: sudo hexad --config {file} --allow {HERE}\n"), told.stderr
    told = as_stranger("--config", file, "--deny", "@no-such-group")
    assert told.returncode == 2 and "sudo" not in told.stderr


def test_a_device_is_not_replaced_by_a_file(other):
    device = other.root / "null"
    try:
        os.mknod(device, 0o666 | stat.S_IFCHR, os.stat("/dev/null").st_rdev)
        device.read_bytes()
    except PermissionError:
        pytest.skip("devices cannot be made or opened here")
    done = other.hexad("--config", device, "--allow", HERE)
    assert done.returncode == 2 and f"{device} is not a regular file" in done.stderr and device.is_char_device()


def test_settings_that_the_unit_does_not_read_change_alone(other):
    before = other.mode()
    shown = other.expect("--allow", HERE, "--state_dir", other.root / "state")
    assert other.file.read_text() == f"workers = 2\nunix_users = {HERE}\n"
    assert other.calls() == [] and not other.units.exists() and other.mode() == before
    assert f"kill -HUP $(cat {other.root}/state/lock)" in shown and f"may use unix:{other.root}/state/hexad.sock" in shown
    assert "kill -HUP" in other.expect("--deny", HERE) and other.calls() == []
    assert other.file.read_text() == "workers = 2\n"


def test_a_port_of_the_socket_unit_is_warned_of(host):
    """Unless the unit has the Unix socket as well."""
    (host.root / "bin/Listen").write_text(f"127.0.0.1:8642 (Stream)\n{host.root}/hexad.sock (Stream)\n")
    assert "may use" in host.expect("--allow", HERE)
    (host.root / "bin/Listen").write_text("127.0.0.1:8642 (Stream)\n")
    done = host.hexad("--allow", HERE)
    assert done.returncode == 0 and "TCP port, where unix_users has no effect" in done.stderr and "may use" not in done.stdout


@pytest.fixture
def public_directory():
    """A directory that every user can reach."""
    if os.geteuid() != 0:
        pytest.skip("only root can be other users")
    with tempfile.TemporaryDirectory() as path:
        os.chmod(path, 0o755)
        yield path


@pytest.mark.sanitized
def test_a_tcp_port_and_a_closed_directory_are_warned_of(other, public_directory):
    state = f"{public_directory}/state"
    os.mkdir(state, 0o700)

    def last_line(*words):
        done = other.hexad(*words, "--state_dir", state)
        assert done.returncode == 0
        return (done.stderr or done.stdout).splitlines()[-1]
    told = last_line("--allow", "60003")
    assert told.startswith(f"hexad: warning: 60003 cannot enter {state} (mode 0700)") and "set listen = unix:/PATH" in told
    assert f"warning: the members of 60003 cannot enter {state}" in last_line("--allow", "@60003")
    assert last_line("--allow", HERE) == f"then {HERE} may use unix:{state}/hexad.sock"
    assert last_line("--allow", "60003", "--listen", f"unix:{public_directory}/s") == f"then 60003 may use unix:{public_directory}/s"
    told = last_line("--allow", "60003", "--listen", "127.0.0.1:0")
    assert "TCP port, where unix_users has no effect" in told and f"`hexadctl token add 60003 --file {state}/tokens`" in told
    os.chmod(state, 0o710)
    os.chown(state, -1, 60003)
    assert last_line("--allow", "@60003").startswith("then the members of 60003 may use")
    assert "cannot enter" in last_line("--allow", "60003")


def list_as_stranger(build, where, word="list"):
    return subprocess.run([sys.executable, "-c", ASK_AS, build / "hexadctl", "--server", f"unix:{where}", word],
                          capture_output=True, text=True, timeout=PATIENCE_S)


def test_reload_sets_the_mode_of_the_socket_only_if_sharing_changes(new_service, tmp_path):
    settings, where = tmp_path / "hexad.conf", tmp_path / "s"
    settings.write_text("unix_users = 60001\n")
    service = new_service("--listen", f"unix:{where}", "--config", settings).start()

    def mode_after(text):
        settings.write_text(text)
        done = service.log.read_text().count("settings reloaded")
        service.process.send_signal(signal.SIGHUP)
        wait_until(lambda: service.log.read_text().count("settings reloaded") > done, "the reload")
        return where.stat().st_mode & 0o777

    where.chmod(0o660)  # by an administrator
    assert mode_after("unix_users = 60001, 60002\n") == 0o660
    assert mode_after("") == 0o700
    assert mode_after("unix_users = 60001\n") == 0o666


def test_reload_grants_and_revokes_access(new_service, build, public_directory):
    """The settings file of a running service is changed; its socket is one that it opened by itself."""
    settings, where = f"{public_directory}/hexad.conf", f"{public_directory}/s"
    with open(settings, "w") as file:
        file.write("unix_users = 60001\n")
    service = new_service("--listen", f"unix:{where}", "--config", settings).start()

    def reloaded(text):
        with open(settings, "w") as file:
            file.write(text)
        done = service.log.read_text().count("settings reloaded")
        service.process.send_signal(signal.SIGHUP)
        wait_until(lambda: service.log.read_text().count("settings reloaded") > done, "the reload")

    stranger = list_as_stranger(build, where)
    assert stranger.returncode == 2 and f"run `hexad --config {settings} --allow 60003` as root" in stranger.stderr, stranger.stderr
    reloaded("unix_users = 60001, 60003\n")
    assert list_as_stranger(build, where).returncode == 0
    reloaded("unix_users = 60001\n")
    assert list_as_stranger(build, where).returncode == 2


def test_a_user_who_is_no_administrator_reads_which_setting_names_them(new_service, build, public_directory):
    where = f"{public_directory}/hexad.sock"
    new_service("--listen", f"unix:{where}", "--unix_users", 60003).start()
    told = list_as_stranger(build, where, "drain")
    assert told.returncode == 2 and "scope admin" in told.stderr and "ask the administrator to add" in told.stderr and "unix_admins" in told.stderr


def test_a_service_without_a_settings_file_is_to_be_restarted(new_service, build, public_directory):
    where = f"{public_directory}/s"
    new_service("--listen", f"unix:{where}", "--unix_users", "60001").start()
    told = list_as_stranger(build, where)
    assert told.returncode == 2 and "restart it with 60003 in its option --unix_users" in told.stderr, told.stderr
    assert "--allow" not in told.stderr


def test_a_change_without_a_file_is_of_the_file_that_the_unit_names(host):
    """ExecStart= of the unit may name another file than the default of hexad."""
    done = host.hexad("--allow", HERE, config=())
    assert done.returncode == 0 and f"{host.file}: added unix_users = {HERE}" in done.stdout, done
    assert host.drop_in.exists() and host.calls() == BOTH


def test_hexadctl_names_the_command_that_grants_access(build, public_directory):
    """A socket that others may not connect to, as that of the unit."""
    where = f"{public_directory}/hexad.sock"
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(where)
        listening.listen()
        os.chmod(where, 0o660)
        told = list_as_stranger(build, where)
        assert told.returncode == 3 and "run `hexad --config FILE --allow 60003` as root, with the settings file" in told.stderr
        assert "or restart it with 60003 in its option --unix_users" in told.stderr
        assert "start hexad" not in told.stderr
        os.chmod(public_directory, 0o700)
        told = list_as_stranger(build, where)
        assert told.returncode == 3 and "directory" in told.stderr and "start hexad" not in told.stderr


RESET = "`systemctl reset-failed hexad.service hexad.socket`"


def with_units(tmp_path, installed):
    """The environment of a machine where systemd has the units of hexad, or not."""
    units = tmp_path / "units"
    units.mkdir()
    if installed:
        (units / "hexad.socket").touch()
    return {**os.environ, "SYSTEMD_UNIT_PATH": f"{tmp_path}/none:{units}"}


@pytest.mark.parametrize("installed", [True, False])
def test_hexadctl_asks_for_a_start_where_nothing_answers(build, tmp_path, installed):
    told = subprocess.run([build / "hexadctl", "--server", f"unix:{tmp_path}/none", "list"], env=with_units(tmp_path, installed),
                          capture_output=True, text=True)
    assert told.returncode == 3 and "start hexad" in told.stderr
    for words in "`systemctl start hexad.socket hexad.service`", "`journalctl -u hexad -n 20`", RESET:
        assert (words in told.stderr) == installed, told.stderr
    for words in "`hexad --state_dir DIR &`", "install the package hexad":
        assert (words in told.stderr) != installed, told.stderr


@pytest.mark.parametrize("installed", [True, False])
def test_hexadctl_ends_with_status_3_if_a_start_fails_while_it_waits(build, tmp_path, installed):
    """systemd listens, does not answer for a service that fails, then closes the socket."""
    where = tmp_path / "hexad.sock"
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(where))
        listening.listen()
        waiting = subprocess.Popen([build / "hexadctl", "--server", f"unix:{where}", "list"], env=with_units(tmp_path, installed),
                                   stderr=subprocess.PIPE, text=True)
        accepted, _ = listening.accept()
        assert accepted.recv(1)
        accepted.close()
    told = waiting.communicate(timeout=PATIENCE_S)[1]
    assert waiting.returncode == 3 and "Connection reset by peer: hexad ended" in told, told
    assert ("`journalctl -u hexad -n 20` says why" in told) == installed and (RESET in told) == installed, told
    after = subprocess.run([build / "hexadctl", "--server", f"unix:{where}", "list"], capture_output=True, text=True, timeout=PATIENCE_S)
    assert after.returncode == 3 and "cannot connect (Connection refused): start hexad" in after.stderr
