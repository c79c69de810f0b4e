# SPDX-License-Identifier: Apache-2.0
"""What a monitor sees: figures that are true, alert rules that fire in their cases and no other, and a dashboard whose
panels show something, in a Prometheus that watches the service."""
import http.client
import json
import re
import shutil
import socket
import subprocess
import urllib.parse

import pytest

from receivers import SECRET, hooked
from service import PATIENCE_S, gated_worker, sphere, wait_until

WELL = {  # of a service that is well, as Prometheus' unit tests write series
    'up{job="hexad"}': "1", "hexad_database_damaged": "0", "hexad_storage_free_bytes": "5000",
    "hexad_state_lost": "0", "hexad_storage_writable": "1",
    "hexad_storage_floor_bytes": "1000", 'hexad_jobs{state="queued"}': "7", "hexad_attempts_running": "2",
    "hexad_draining": "0", "hexad_held": "0", "hexad_results_full": "0",
    'hexad_http_answers_total{class="5xx"}': "3", "hexad_http_refused_connections_total": "0",
    "hexad_oldest_waiting_job_age_seconds": "3600", "hexad_webhooks_oldest_age_seconds": "5",
    'hexad_attempts_total{outcome="failed",code="internal"}': "9",
    'hexad_attempts_total{outcome="retried",code="internal"}': "2",
    'hexad_attempts_total{outcome="failed",code="no_surface"}': "0+5",
    'hexad_webhook_calls_total{result="given_up"}': "1", 'hexad_webhook_calls_total{result="failed"}': "0+5",
}
CASES = {  # what is different, and which alerts fire then
    "well": ({}, set()),
    "down": ({'up{job="hexad"}': "0"}, {"HexadDown"}),
    "damaged": ({"hexad_database_damaged": "1"}, {"HexadDatabaseDamaged"}),
    "lost": ({"hexad_state_lost": "1"}, {"HexadStateLost"}),
    "unwritable": ({"hexad_storage_writable": "0"}, {"HexadStorageUnwritable"}),
    "low": ({"hexad_storage_free_bytes": "1500"}, {"HexadDiskNearlyFull"}),
    "full": ({"hexad_storage_free_bytes": "900"}, {"HexadDiskFull", "HexadDiskNearlyFull"}),
    "stuck": ({"hexad_attempts_running": "0"}, {"HexadNothingRuns"}),
    "idle": ({"hexad_attempts_running": "0", 'hexad_jobs{state="queued"}': "0"}, set()),
    "late": ({"hexad_oldest_waiting_job_age_seconds": "90000"}, {"HexadJobsWaitLong"}),
    "crashes": ({'hexad_attempts_total{outcome="retried",code="internal"}': "0+1"}, {"HexadAttemptsCrash"}),
    "deaf": ({"hexad_webhooks_oldest_age_seconds": "4000"}, {"HexadWebhooksWait"}),
    "untold": ({'hexad_webhook_calls_total{result="given_up"}': "0+1"}, {"HexadWebhooksGivenUp"}),
    "drained": ({"hexad_attempts_running": "0", "hexad_draining": "1"}, {"HexadDrained"}),
    "undelivered": ({"hexad_jobs_undelivered": "2"}, {"HexadResultsUndelivered"}),
    "kept": ({"hexad_results_full": "1"}, {"HexadResultsFull"}),
    "held": ({"hexad_attempts_running": "0", "hexad_held": "1"}, set()),
    "errors": ({'hexad_http_answers_total{class="5xx"}': "0+5"}, {"HexadServerErrors"}),
    "refusals": ({"hexad_http_refused_connections_total": "0+5"}, {"HexadConnectionsRefused"}),
}


@pytest.fixture
def rules(source):
    return source / "etc/hexad.rules.yml"


@pytest.fixture
def promtool():
    tool = shutil.which("promtool")
    if not tool:
        pytest.skip("no promtool (Debian: prometheus)")
    return lambda *words, **more: subprocess.run([tool, *map(str, words)], capture_output=True, text=True,
                                                 timeout=PATIENCE_S, **more)


def alerts_of(rules):
    return re.findall(r"alert: (\w+)", rules.read_text())


@pytest.mark.extended
def test_promtool_accepts_the_rules(rules, promtool):
    done = promtool("check", "rules", rules)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(alerts_of(rules))} rules found" in done.stdout


def expressions(source):
    """Of the rules and of the dashboard, whose variables are filled in."""
    rules = re.findall(r"expr: (.*)", (source / "etc/hexad.rules.yml").read_text())
    board = json.loads((source / "etc/hexad.dashboard.json").read_text())
    shown = [t["expr"] for panel in board["panels"] for t in panel["targets"]]
    assert len(rules) >= 10 and len(shown) >= 20
    return rules, [e.replace("$__rate_interval", "1m").replace("$instance", ".*") for e in shown]


def test_the_service_has_their_metrics(source, service):
    rules, shown = expressions(source)
    sent = service.get("/metrics").body.decode().splitlines()
    used = set(re.findall(r"(hexad_\w+)(?:\{([^}]*)\})?", "\n".join(rules + shown)))
    assert len(used) >= 25
    for name, labels in used:
        wanted = [pair for pair in re.split(", ?", labels) if re.fullmatch(r'\w+="[^"]*"', pair)]
        assert any(re.match(name + "[{ ]", line) and all(pair in line for pair in wanted) for line in sent), name


@pytest.mark.extended
def test_promtool_has_no_complaint_about_metrics(service, promtool):
    service.wait_state(service.submit(sphere()), "succeeded")
    done = promtool("check", "metrics", input=service.get("/metrics").body.decode())
    assert done.returncode == 0 and not done.stdout + done.stderr, done.stdout + done.stderr


def figure(service, series):
    """The value of one series."""
    return float(re.search(rf"^{re.escape(series)} (\S+)$", service.get("/metrics").body.decode(), re.M)[1])


def test_attempts_are_counted_by_outcome_and_code(service):
    def ended(outcome, code):
        return figure(service, f'hexad_attempts_total{{outcome="{outcome}",code="{code}"}}')

    assert ended("converged", "none") == ended("failed", "no_surface") == figure(service, "hexad_job_wait_seconds_count") == 0
    spec = sphere()
    done = service.wait_state(service.submit(spec), "succeeded")
    again = service.wait_state(service.submit(spec), "succeeded")
    empty = sphere(region={"min": [5, 5, 5], "max": [6, 6, 6]})
    failed = service.wait_state(service.submit(empty), "failed")
    assert again["cached_from"] == done["id"] and failed["error"]["code"] == "no_surface"
    # the daemon counts an attempt once its end is stored, which others may see before
    wait_until(lambda: ended("failed", "no_surface"), "the failed attempt to be counted")
    assert ended(done["outcome"], "none") == 2 and ended("failed", "no_surface") == 1
    assert figure(service, "hexad_cache_hits_total") == 1 and figure(service, "hexad_cache_misses_total") == 2
    assert figure(service, "hexad_job_wait_seconds_count") == 3
    assert figure(service, 'hexad_attempt_duration_seconds_bucket{le="+Inf"}') == 2  # one had no worker
    assert figure(service, "hexad_attempt_duration_seconds_sum") > 0
    assert figure(service, "hexad_database_size_bytes") > 0
    assert figure(service, "hexad_storage_size_bytes") >= figure(service, "hexad_storage_free_bytes")


@pytest.mark.sanitized
def test_what_waits_has_an_age(new_service, tmp_path, receiver):
    secret = tmp_path / "secret"
    secret.write_text(SECRET)
    secret.chmod(0o600)
    service = new_service("--worker", gated_worker(tmp_path), "--workers", "1", "--webhook_hosts", receiver.host,
                          "--webhook_secret_file", secret).start()
    assert figure(service, "hexad_oldest_waiting_job_age_seconds") == 0
    runs = service.submit(hooked(receiver))
    service.wait_worker(runs)
    waits = service.submit(sphere())
    wait_until(lambda: figure(service, "hexad_oldest_waiting_job_age_seconds") > 0, "the age")
    assert figure(service, 'hexad_jobs{state="queued"}') == figure(service, 'hexad_jobs{state="running"}') == 1
    receiver.answers.put(500)
    service.open_gate(runs)
    receiver.next()
    wait_until(lambda: figure(service, 'hexad_webhook_calls_total{result="failed"}') == 1, "the count")
    assert figure(service, "hexad_webhooks_waiting") == 1 and figure(service, "hexad_webhooks_oldest_age_seconds") > 0
    service.open_gate(waits)
    service.wait_state(waits, "succeeded")
    assert figure(service, "hexad_oldest_waiting_job_age_seconds") == 0


class Monitor:
    """Debian's Prometheus, which watches the service and has the rules."""

    def __init__(self, service, rules, where):
        with socket.socket() as free:  # Prometheus cannot tell which port it has taken
            free.bind(("127.0.0.1", 0))
            self.address = "127.0.0.1:%d" % free.getsockname()[1]
        settings = {"global": {"scrape_interval": "100ms", "evaluation_interval": "100ms"}, "rule_files": [str(rules)],
                    "scrape_configs": [{"job_name": "hexad", "static_configs": [{"targets": [service.address]}]}]}
        (where / "prometheus.yml").write_text(json.dumps(settings))
        self.log = open(where / "prometheus.log", "wb")
        self.process = subprocess.Popen(
            [shutil.which("prometheus"), f"--config.file={where}/prometheus.yml", f"--storage.tsdb.path={where}/series",
             f"--web.listen-address={self.address}"], stdout=self.log, stderr=self.log)

    def ask(self, path, **words):
        connection = http.client.HTTPConnection(self.address, timeout=PATIENCE_S)
        try:
            connection.request("GET", f"/api/v1/{path}?{urllib.parse.urlencode(words)}")
            answer = connection.getresponse()
            body = answer.read()
        except OSError:
            return None  # it does not listen yet
        finally:
            connection.close()
        if answer.status == 503:
            return None  # it starts
        reply = json.loads(body)
        assert reply["status"] == "success", (words, reply)
        return reply["data"]

    def end(self):
        self.process.kill()
        self.process.wait()
        self.log.close()


@pytest.fixture
def monitor(source, service, tmp_path):
    if not shutil.which("prometheus"):
        pytest.skip("no prometheus (Debian: prometheus)")
    made = Monitor(service, source / "etc/hexad.rules.yml", tmp_path)
    yield made
    made.end()


@pytest.mark.extended
def test_a_prometheus_shows_every_panel(source, service, monitor, rules):
    _, shown = expressions(source)
    for expression in shown:
        wait_until(lambda e=expression: (monitor.ask("query", query=e) or {}).get("result"), expression)
    loaded = monitor.ask("rules")["groups"][0]["rules"]
    assert [rule["name"] for rule in loaded] == alerts_of(rules)
    wait_until(lambda: all(r["health"] == "ok" for r in monitor.ask("rules")["groups"][0]["rules"]), "evaluations")
    assert monitor.ask("alerts")["alerts"] == []


@pytest.mark.extended
def test_each_fires_in_its_case(rules, promtool, tmp_path):
    alerts = alerts_of(rules)
    assert set().union(*(fired for _, fired in CASES.values())) == set(alerts)
    tests = []
    for name, (different, fired) in CASES.items():
        series = [{"series": s, "values": f"{v}x600" if "+" in v else f"{v}+0x600"} for s, v in {**WELL, **different}.items()]
        expected = [{"eval_time": "9h", "alertname": alert} for alert in alerts if alert not in fired]
        firing = {"eval_time": "9h", "expr": 'count by (alertname) (ALERTS{alertstate="firing"})',
                  "exp_samples": [{"labels": f'{{alertname="{alert}"}}', "value": 1} for alert in sorted(fired)]}
        tests.append({"name": name, "interval": "1m", "input_series": series, "alert_rule_test": expected,
                      "promql_expr_test": [firing]})
    file = tmp_path / "tests.yml"  # JSON is YAML
    file.write_text(json.dumps({"rule_files": [str(rules)], "evaluation_interval": "1m", "tests": tests}))
    done = promtool("test", "rules", file)
    assert done.returncode == 0, done.stdout + done.stderr
