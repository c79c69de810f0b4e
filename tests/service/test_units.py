# SPDX-License-Identifier: Apache-2.0
"""The units of systemd: verified, and so tight that systemd-analyze gives an exposure of 0.6, and 1.5 at most with an
example."""
import os
import re
import shutil
import subprocess

import pytest

from service import OPEN_TCP

EXPOSURE = 0.6


@pytest.fixture
def units(build, tmp_path):
    """The built units, with the program where it is now: verify looks for it."""
    if not shutil.which("systemd-analyze"):
        pytest.skip("systemd-analyze is not installed")
    service = (build / "systemd/hexad.service").read_text()
    service, count = re.subn(r"^(Exec\w+)=/\S+/hexad --config /\S+/hexad.conf",
                             rf"\1={build}/hexad --config /etc/hexad.conf", service, flags=re.M)
    assert count == 2  # ExecStart, ExecReload
    (tmp_path / "hexad.service").write_text(service)
    shutil.copy(build / "systemd/hexad.socket", tmp_path)
    return tmp_path


def analyze(*words):
    return subprocess.run(["systemd-analyze", *map(str, words)], capture_output=True, text=True)


def test_units_are_verified(units):
    done = analyze("verify", "--man=no", units / "hexad.service", units / "hexad.socket")
    assert done.returncode == 0 and not done.stderr + done.stdout, done.stderr


def test_exposure(units, diagnose):
    done = analyze("security", "--offline=yes", f"--threshold={EXPOSURE * 10:.0f}", units / "hexad.service")
    assert done.returncode == 0, done.stdout + done.stderr
    diagnose(re.search(r"Overall exposure level.*", done.stdout)[0].encode("ascii", "ignore").decode())


@pytest.mark.parametrize("unit, name, told, exposure", [
    ("hexad.socket", "tcp", "ListenStream=127.0.0.1:8642", 0.6),
    ("hexad.service", "webhooks", "IPAddressAllow=any", 1.5),
    ("hexad.service", "mounts", "RequiresMountsFor=/mnt/show", 0.6),
    ("hexad.service", "memory", "Delegate=memory", 0.8)], ids=["tcp", "webhooks", "mounts", "memory"])
def test_examples_are_verified(units, source, diagnose, unit, name, told, exposure):
    """Each as the drop-in that its first lines say it is."""
    text = (source / f"systemd/examples/{name}.conf").read_text()
    assert f"/etc/systemd/system/{unit}.d/{name}.conf" in text and told in text.splitlines()
    (units / f"{unit}.d").mkdir()
    (units / f"{unit}.d/{name}.conf").write_text(text)
    done = analyze("verify", "--man=no", units / "hexad.service", units / "hexad.socket")
    assert done.returncode == 0 and not done.stderr + done.stdout, done.stderr
    done = analyze("security", "--offline=yes", f"--threshold={exposure * 10:.0f}", units / "hexad.service")
    assert done.returncode == 0, done.stdout + done.stderr
    diagnose(name + ": " + re.search(r"Overall exposure level.*", done.stdout)[0].encode("ascii", "ignore").decode())


def test_a_reload_checks_the_settings_first(units, build, tmp_path):
    """systemd runs the commands in order, and ends with the first that fails."""
    settings = tmp_path / "hexad.conf"
    start, first, second = re.findall(r"^Exec(?:Start|Reload)=(.*)$", (units / "hexad.service").read_text(), re.M)
    assert first == f"{start} --check-settings" and "kill -HUP $MAINPID" in second
    for text, status in (("workers = 2\n", 0), ("workers = many\n", 2)):
        settings.write_text(text)
        assert subprocess.run([build / "hexad", "--config", settings, "--check-settings"], stdout=subprocess.DEVNULL).returncode == status


def test_starts_with_a_pause_never_reach_the_limit(units):
    """A mount may come hours late."""
    text = (units / "hexad.service").read_text()
    pause, interval, burst = (int(re.search(rf"^{key}=(\d+)$", text, re.M)[1])
                              for key in ("RestartSec", "StartLimitIntervalSec", "StartLimitBurst"))
    assert pause >= 1 and interval / pause + 1 < burst


def test_times_agree(units, build):
    """What systemd waits for at a stop is more than a drain takes by its defaults."""
    sample = subprocess.run([build / "hexad", "--print-config"], capture_output=True, text=True, check=True).stdout
    drain, grace = (float(re.search(rf"^#{key} = (.*)$", sample, re.M)[1]) for key in ("drain_s", "grace_s"))
    stop = float(re.search(r"^TimeoutStopSec=(\d+)$", (units / "hexad.service").read_text(), re.M)[1])
    assert stop >= drain + grace + 10


@pytest.mark.parametrize("listens, token, active, conf, told", [
    ("127.0.0.1:8642", False, False, "#token_file =\ntoken_file =\n", True), ("127.0.0.1:8642", True, False, "", False),
    ("127.0.0.1:8642", False, True, "", False), ("/run/other.sock", False, False, "", False), (None, False, False, "", False),
    ("127.0.0.1:8642", False, False, "token_file = /srv/tokens\n", False),
    ("127.0.0.1:8642", False, False, f"workers = 2\ntcp_without_tokens = {OPEN_TCP}\n", False)])
def test_an_installation_with_a_port_and_without_tokens_says_what_to_do(source, tmp_path, listens, token, active, conf, told):
    """As after a purge that left a drop-in of the administrator."""
    units = tmp_path.joinpath("etc", "systemd", "system", "hexad.socket.d")
    programs, settings = tmp_path / "bin", tmp_path.joinpath("etc", "hexad")
    for directory in units, programs, settings, tmp_path.joinpath("run", "systemd", "system"):
        directory.mkdir(parents=True)
    if listens:
        (units / "tcp.conf").write_text(f"[Socket]\nListenStream={listens}\n")
    (settings / "tokens").write_text("token\n" if token else "")
    tmp_path.joinpath("etc", "hexad.conf").write_text(conf)
    (programs / "systemctl").write_text(f"#!/bin/sh\nexit {0 if active else 3}\n")
    (programs / "systemctl").chmod(0o755)
    script = (source / "debian/hexad.postinst").read_text()
    for place in "/etc/", "/run/":
        script = script.replace(f" {place}", f" {tmp_path}{place}")
    done = subprocess.run(["sh", "-s", "configure", ""], input=script, env={**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"},
                          capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr
    assert ("hexadctl token add USER" in done.stdout) == told and done.stdout.count("\n") == told
