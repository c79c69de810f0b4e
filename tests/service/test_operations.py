# SPDX-License-Identifier: Apache-2.0
"""What doc/operations.md says can be typed in, typed in: its blocks of shell, in order, on hosts that are directories.

A host has the paths of the page below a directory of its own, and the user of the test instead of the user hexad.
`systemctl` and `journalctl` are scripts that start and end the real hexad as the unit would, on a Unix socket; all else
are the programs of the page.
"""
import json
import os
import random
import re
import shutil
import signal
import subprocess
import textwrap

import pytest

from service import PATIENCE_S, UnixConnection, sphere, wait_until

PATHS = ("/var/lib", "/var/backups", "/run/hexad", "/run/systemd", "/etc/hexad.conf")

SYSTEMCTL = """#!/bin/sh
# starts hexad as the unit does, by the last ExecStart= of its drop-ins, and waits until it serves
case "$1" in
start)
    echo "$*" | grep -q hexad.service || exit 0
    line=$(cat "$HOST"/run/systemd/system/hexad.service.d/*.conf 2>/dev/null | grep -a '^ExecStart=.' | tail -n 1)
    [ "$line" ] || line="ExecStart=hexad --config $HOST/etc/hexad.conf"
    rm -f "$HOST/port"
    mkdir -p "$HOST/run/hexad"
    STATE_DIRECTORY="$HOST/var/lib/hexad" RUNTIME_DIRECTORY="$HOST/run/hexad" setsid ${line#ExecStart=} --port_file "$HOST/port" \\
        </dev/null >>"$HOST/journal" 2>&1 &
    pid=$!
    echo $pid >"$HOST/pid"
    until [ -e "$HOST/port" ]; do kill -0 $pid 2>/dev/null || exit 1; sleep 0.05; done ;;
stop)
    pid=$(cat "$HOST/pid" 2>/dev/null) || exit 0
    kill "$pid" 2>/dev/null
    while kill -0 "$pid" 2>/dev/null; do sleep 0.05; done
    rm -f "$HOST/pid" ;;
daemon-reload) ;;
*) exit 64 ;;
esac
"""


class Host:
    def __init__(self, build, root):
        self.root = root
        for path in ("var/lib", "run/systemd/system", "etc", "bin"):
            (root / path).mkdir(parents=True)
        (root / "etc/hexad.conf").write_text("workers = 2\ndrain_s = 0\ngrace_s = 0\n")
        for program in ("hexad", "hexadctl", "hexad-worker"):
            (root / "bin" / program).symlink_to(build / program)
        for name, text in (("systemctl", SYSTEMCTL), ("journalctl", '#!/bin/sh\ncat "$HOST/journal"\n')):
            (root / "bin" / name).write_text(text)
            (root / "bin" / name).chmod(0o755)
        self.state = root / "var/lib/hexad"
        self.socket = root / "run/hexad/hexad.sock"

    def run(self, *blocks):
        """Types blocks into one shell, and gives what it shows."""
        script = "".join(blocks)
        for path in PATHS:
            script = script.replace(path, f"{self.root}{path}")
        script = script.replace("-o hexad -g hexad", f"-o {os.geteuid()} -g {os.getegid()}")
        environment = {**os.environ, "HOST": str(self.root), "HEXAD_SERVER": f"unix:{self.socket}",
                       "PATH": f"{self.root}/bin:{os.environ['PATH']}"}
        with open(self.root / "shown", "w+") as shown:  # no pipe: hexad itself would keep it open
            done = subprocess.run(["bash", "-eu", "-o", "pipefail", "-c", script], cwd=self.root, env=environment,
                                  stdin=subprocess.DEVNULL, stdout=shown, stderr=subprocess.STDOUT,
                                  timeout=PATIENCE_S)
            shown.seek(0)
            text = shown.read()
        assert done.returncode == 0, f"{script}\n{text}\n{self.log()}"
        return text

    def log(self):
        journal = self.root / "journal"
        return journal.read_text() if journal.exists() else ""

    def restart(self, settings="", expect=True):
        """With settings of a test's own."""
        self.run("systemctl stop hexad.socket hexad.service\n")
        (self.root / "etc/hexad.conf").write_text("workers = 2\ndrain_s = 0\ngrace_s = 0\n" + settings)
        self.run("systemctl start hexad.socket hexad.service" + ("\n" if expect else " && exit 1 || true\n"))

    def ask(self, method, path, document=None):
        connection = UnixConnection(str(self.socket))
        try:
            connection.request(method, path, json.dumps(document) if document else None,
                               {"Content-Type": "application/json"})
            reply = connection.getresponse()
            text = reply.read()
            return reply.status, json.loads(text) if text else None
        finally:
            connection.close()

    def submit(self, state="succeeded", **parts):
        status, job = self.ask("POST", "/v1/jobs", sphere(**parts))
        assert status == 201, job
        wait_until(lambda: self.state_of(job["id"]) == state, f"{job['id']} to be {state}")
        return job["id"]

    def state_of(self, job):
        status, document = self.ask("GET", f"/v1/jobs/{job}")
        return document["state"] if status == 200 else None

    def has_result(self, job):
        return self.ask("GET", f"/v1/jobs/{job}/results")[0] == 200

    def readiness(self):
        return self.ask("GET", "/readyz")[1]["checks"]

    def clean_up(self):
        if (self.root / "pid").exists():
            try:
                os.kill(int((self.root / "pid").read_text()), signal.SIGKILL)
            except ProcessLookupError:
                pass


@pytest.fixture
def page(source):
    return (source / "doc/operations.md").read_text()


def sections(page):
    """(title, [(mark, commands)]) in the order of the page; a block in a list is indented."""
    found = []
    for part in re.split(r"^##+ ", page, flags=re.M):
        title, _, text = part.partition("\n")
        blocks = [(mark, textwrap.dedent(indent + commands)) for indent, mark, commands in
                  re.findall(r"^( *)```sh *([\w-]*)\n(.*?)^ *```$", text, re.M | re.S)]
        found.append((title, blocks))
    return found


@pytest.fixture
def new_host(build, tmp_path):
    made = []

    def make():
        made.append(Host(build, tmp_path / f"host{len(made)}"))
        return made[-1]

    yield make
    for host in made:
        host.clean_up()


def overwrite(database, seed):
    """All pages but the first, which a start would refuse; that is tried elsewhere."""
    rest = database.stat().st_size - 4096
    with open(database, "r+b") as file:
        file.seek(4096)
        file.write(random.Random(seed).randbytes(rest))


class Story:
    """What happens to the hosts before a section is needed, and what has to be true after it."""

    def __init__(self, new_host):
        self.new_host, self.host = new_host, new_host()
        self.host.state.mkdir(mode=0o700)
        self.host.run("systemctl start hexad.socket hexad.service\n")
        self.kept = [self.host.submit(count=200 + i) for i in range(3)]
        self.back_up()

    def back_up(self):
        """As the section Backup does, for the sections in front of it."""
        self.host.run("export STATE_DIRECTORY=/var/lib/hexad\nmkdir -p /var/backups/hexad\n",
                      "hexad --backup /var/backups/hexad/queue.db\n")

    def expect_kept(self, host=None):
        host = host or self.host
        for job in self.kept:
            assert host.state_of(job) == "succeeded" and host.has_result(job), job

    # -- before and after sections, by their titles

    def after_check_the_service(self, shown):
        assert '"status":"ok"' in shown and "no faults in the database" in shown

    def after_the_service_does_not_start(self, shown):
        assert "listening on" in shown

    def before_a_job_does_not_run(self):
        self.host.run("hexadctl hold\n")
        self.waiting = self.host.submit("queued", count=303)

    def after_a_job_does_not_run(self, shown):
        assert "held: " in shown and self.waiting in shown
        self.host.run("hexadctl release\n")
        wait_until(lambda: self.host.state_of(self.waiting) == "succeeded", "the job to run")
        self.back_up()

    def after_damaged_files(self, shown):
        assert not shown  # test_damaged_files.py damages files

    def after_results_that_were_not_delivered(self, shown):
        assert not shown  # test_isolation.py delivers a result again

    def after_a_user_cannot_connect(self, shown):
        assert not shown  # test_allow.py runs hexad --allow

    def after_change_a_setting(self, shown):
        assert not shown  # a table of settings

    def after_stop_at_once(self, shown):
        assert not shown  # test_lifecycle.py ends hexad with a second signal

    def after_directories_outside_of_the_state(self, shown):
        assert not shown  # `make bootcheck` starts hexad with such drop-ins

    def after_a_directory_for_each_user(self, shown):
        assert not shown  # test_isolation.py makes such directories

    def after_monitoring(self, shown):
        succeeded = self.host.ask("GET", "/v1/jobs?state=succeeded&limit=500")[1]["jobs"]
        assert f'hexad_jobs{{state="succeeded"}} {len(succeeded)}' in shown and "hexad_database_damaged 0" in shown

    def before_unusual_characters_in_logs_and_messages(self):
        self.host.submit(name="a\u202eb")

    def after_unusual_characters_in_logs_and_messages(self, shown):
        assert r"a\u{202e}b" in shown and '"name": "aM-bM-^@M-.b"' in shown

    def before_the_web_page(self):
        self.key = (self.host.state / "session.key").read_bytes()

    def after_the_web_page(self, shown):
        assert (self.host.state / "session.key").read_bytes() != self.key
        self.expect_kept()

    def after_users(self, shown):
        assert not shown  # test_allow.py and `make bootcheck` run hexad --allow

    def after_shares_of_users(self, shown):
        assert "held: " in shown and self.host.readiness()["queue"] == "ok"

    def before_backup(self):
        self.deleted = self.host.submit(count=299)

    def after_backup(self, shown):
        backups = self.host.root / "var/backups/hexad"
        names = {p.name for p in backups.iterdir()}
        assert names >= {"queue.db", "instance", "results", "inputs"} and not names & {"lock", "copies"}
        assert "no faults in the database and" in shown
        self.late = self.host.submit(count=300)
        assert self.host.ask("DELETE", f"/v1/jobs/{self.deleted}")[0] == 204

    def before_try_a_backup(self):
        self.backup = {p: p.stat().st_mtime_ns for p in (self.host.root / "var/backups/hexad").rglob("*")}
        self.process = (self.host.root / "pid").read_text()

    def after_try_a_backup(self, shown):
        assert "no faults in the database and" in shown and "storage_full" in shown and self.deleted in shown and self.late not in shown
        assert (self.host.root / "pid").read_text() == self.process and self.host.state_of(self.late) == "succeeded"
        assert {p: p.stat().st_mtime_ns for p in (self.host.root / "var/backups/hexad").rglob("*")} == self.backup
        assert not list((self.host.root / "var/backups").glob("hexad-trial-*"))

    def after_restore(self, shown):
        self.expect_kept()
        assert self.host.state_of(self.late) is None
        assert (self.host.state / "lost+found/results" / self.late / "report.json").exists()
        assert self.host.state_of(self.deleted) == "succeeded" and self.host.has_result(self.deleted)
        shown = self.host.run("export STATE_DIRECTORY=/var/lib/hexad\nsystemctl stop hexad.socket hexad.service\n",
                              "hexad --check || true\nsystemctl start hexad.socket hexad.service\n")
        assert "no faults in the database and" in shown
        assert self.host.ask("DELETE", f"/v1/jobs/{self.deleted}")[0] == 204

    def after_the_state_directory_is_gone(self, shown):
        self.expect_kept()
        assert self.host.state.stat().st_mode & 0o777 == 0o700 and self.kept[-1] in shown

    def before_upgrade(self):
        self.kept.append(self.host.submit(count=301))

    def after_upgrade(self, shown):
        self.expect_kept()
        assert "drained the service" in shown and self.host.readiness()["jobs"] == "ok"

    def after_another_host(self, shown):
        self.expect_kept()
        self.host.run("export STATE_DIRECTORY=/var/lib/hexad\nhexad --backup /var/backups/hexad/queue.db\n",
                      'cp -au "$STATE_DIRECTORY"/results /var/backups/hexad/\n')

    def after_in_a_container(self, shown):
        assert not shown  # `make containercheck` runs it

    def after_remove(self, shown):
        assert not shown  # `make packagecheck` does

    def after_how_long_results_are_kept(self, shown):
        assert not shown  # a table of settings

    def after_the_old_host_is_gone(self, shown):
        self.expect_kept()

    def before_a_lost_database(self):
        self.host.run("systemctl stop hexad.socket hexad.service\n")
        for file in self.host.state.glob("queue.db*"):
            file.unlink()
        self.host.restart(expect=False)
        assert "queue.db is missing or empty" in self.host.log()

    def after_a_lost_database(self, shown):
        self.expect_kept()
        self.host.restart()
        self.expect_kept()
        assert not list((self.host.root / "run/systemd/system/hexad.service.d").iterdir())

    def before_a_full_disk(self):
        self.failed = self.host.submit("failed", surface={"analytic": {"shape": "sphere", "center": [9, 9, 9], "radius": 1}},
                                       region={"min": [0, 0, 0], "max": [1, 1, 1]})
        (self.host.state / "lost+found").mkdir(exist_ok=True)
        self.host.restart("free_space_mb = 1000000000\n")
        assert self.host.readiness()["storage"] == "full"

    def after_a_full_disk(self, shown):
        assert self.host.state_of(self.failed) is None and not (self.host.state / "lost+found").exists()
        gone = [job for job in self.kept if self.host.state_of(job) is None]
        assert gone == self.kept[:1]
        self.kept.remove(gone[0])
        self.host.restart()
        assert self.host.readiness()["storage"] == "ok"
        self.back_up()

    def before_a_damaged_database(self):
        self.host.restart()
        wait_until(lambda: self.host.readiness()["database"] == "ok", "the quick check")
        self.host.run("systemctl stop hexad.socket hexad.service\n")
        overwrite(self.host.state / "queue.db", 7)

    def after_a_damaged_database(self, shown):
        assert "database damaged" in shown
        self.expect_kept()
        wait_until(lambda: self.host.readiness()["database"] == "ok", "the quick check")

    def before_a_directory_that_cannot_be_written(self):
        self.host.restart()
        (self.host.state / "results").rename(self.host.state / "old-results")
        wait_until(lambda: self.host.readiness()["storage"] == "unwritable", "word of it")

    def after_a_directory_that_cannot_be_written(self, shown):
        assert not shown and "cannot write to" in self.host.log()
        (self.host.state / "old-results").rename(self.host.state / "results")
        wait_until(lambda: self.host.readiness()["storage"] == "ok", "readiness")
        self.expect_kept()

    def before_a_lost_state_directory(self):
        self.host.restart()
        self.host.state.rename(self.host.root / "elsewhere")
        self.host.state.mkdir()
        assert self.host.readiness()["state"] == "lost"

    def after_a_lost_state_directory(self, shown):
        assert f" {self.host.state}\n" in shown and "was replaced by another one" in self.host.log()
        self.host.state.rmdir()
        (self.host.root / "elsewhere").rename(self.host.state)
        assert self.host.readiness()["state"] == "ok"
        self.expect_kept()

    def lose_state(self):
        self.host.run("systemctl stop hexad.socket hexad.service\n")
        shutil.rmtree(self.host.state)

    def change_host(self, mark):
        """Another machine, to which backups were brought; the old one does not run any more."""
        fresh = self.new_host()
        self.host.run("systemctl stop hexad.socket hexad.service\n")
        shutil.copytree(self.host.root / "var/backups", fresh.root / "var/backups")
        if mark == "bare-host":
            assert not fresh.state.exists()
        self.host = fresh


@pytest.mark.extended
def test_the_whole_page(page, new_host):
    (_, [(_, prelude)]), *rest = sections(page)
    story, done = Story(new_host), 0
    for title, blocks in rest:
        name = re.sub(r"\W+", "_", title.lower()).strip("_")
        getattr(story, f"before_{name}", lambda: None)()
        shown = ""
        for mark, block in blocks:
            assert mark in ("", "new-host", "bare-host", "no-state")
            if mark == "no-state":
                story.lose_state()
            elif mark:
                story.change_host(mark)
            shown += story.host.run(prelude, block)
            done += 1
        getattr(story, f"after_{name}")(shown)
    assert done >= 15
    story.host.run("systemctl stop hexad.socket hexad.service\n")


def test_every_section_has_an_end(page):
    """No section of the page goes unlooked at."""
    titles = [re.sub(r"\W+", "_", title.lower()).strip("_") for title, _ in sections(page)[1:]]
    assert {f"after_{name}" for name in titles} == {n for n in vars(Story) if n.startswith("after_")}


def test_the_drop_in_is_one(page, build, source, tmp_path):
    """systemd takes the drop-in that the page writes."""
    analyze = shutil.which("systemd-analyze")
    if not analyze:
        pytest.skip("no systemd-analyze")
    written = re.search(r"printf '([^']*)'", page).group(1).replace("%s", str(build / "hexad")).replace("\\n", "\n")
    unit = tmp_path / "hexad.service"
    unit.write_text(f"[Service]\nType=notify\nExecStart={build}/hexad --config /etc/hexad.conf\n")
    (tmp_path / "hexad.service.d").mkdir()
    (tmp_path / "hexad.service.d/adopt.conf").write_text(written)
    done = subprocess.run([analyze, "verify", unit], capture_output=True, text=True, timeout=PATIENCE_S,
                          env={**os.environ, "SYSTEMD_UNIT_PATH": f"{tmp_path}:"})
    assert "hexad.service" not in done.stderr, done.stderr


def test_the_page_names_all_settings_that_a_reload_applies(page, build):
    """The sample of the settings file says it of each setting, in the comment in front of it."""
    sample = subprocess.run([build / "hexad", "--print-config"], capture_output=True, text=True, check=True).stdout
    reloads = {re.search(r"^#(\w+) =", part, re.M)[1] for part in sample.split("\n\n")[1:] if "SIGHUP reloads it" in part}
    row = {line.split("|")[2].strip(): re.findall(r"`(\w+)`", line.split("|")[1]) for line in page.splitlines()
           if re.match(r"\|.*\| `systemctl re(load|start) hexad.service` \|", line)}
    assert len(row) == 2 and reloads and sorted(row["`systemctl reload hexad.service`"]) == sorted(reloads)
    assert not reloads.intersection(row["`systemctl restart hexad.service`"])
