"""The alert rules: promtool accepts them, the service has their metrics, and each fires in its case and no other."""
import json
import re
import shutil
import subprocess

import pytest

from service import PATIENCE_S

WELL = {  # of a service that is well, as Prometheus' unit tests write series
    'up{job="hexad"}': "1", "hexad_database_damaged": "0", "hexad_storage_free_bytes": "5000",
    "hexad_storage_floor_bytes": "1000", 'hexad_jobs{state="queued"}': "7", "hexad_attempts_running": "2",
    "hexad_draining": "0", 'hexad_http_answers_total{class="5xx"}': "3", "hexad_http_refused_connections_total": "0",
}
CASES = {  # what is different, and which alerts fire then
    "well": ({}, set()),
    "down": ({'up{job="hexad"}': "0"}, {"HexadDown"}),
    "damaged": ({"hexad_database_damaged": "1"}, {"HexadDatabaseDamaged"}),
    "low": ({"hexad_storage_free_bytes": "1500"}, {"HexadDiskNearlyFull"}),
    "full": ({"hexad_storage_free_bytes": "900"}, {"HexadDiskFull", "HexadDiskNearlyFull"}),
    "stuck": ({"hexad_attempts_running": "0"}, {"HexadNothingRuns"}),
    "idle": ({"hexad_attempts_running": "0", 'hexad_jobs{state="queued"}': "0"}, set()),
    "drained": ({"hexad_attempts_running": "0", "hexad_draining": "1"}, {"HexadDrained"}),
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
    return lambda *words: subprocess.run([tool, *map(str, words)], capture_output=True, text=True, timeout=PATIENCE_S)


def alerts_of(rules):
    return re.findall(r"alert: (\w+)", rules.read_text())


def test_promtool_accepts_the_rules(rules, promtool):
    done = promtool("check", "rules", rules)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(alerts_of(rules))} rules found" in done.stdout


def test_the_service_has_their_metrics(rules, service):
    used = set(re.findall(r"hexad_[a-z_]+(?:\{[^}]*\})?", "\n".join(re.findall(r"expr: .*", rules.read_text()))))
    sent = service.get("/metrics").body.decode()
    assert len(used) >= 8
    for series in used:
        assert re.search(rf"^{re.escape(series)} ", sent, re.M), series


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
