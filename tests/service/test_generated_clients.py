"""Clients that two generators make of the OpenAPI document compile strictly, and submit, wait and fetch."""
import json
import shutil
import subprocess

import pytest

from service import PATIENCE_S

pytestmark = pytest.mark.extended  # needs npm


@pytest.fixture(scope="module")
def modules(source):
    where = source / "tests/openapi/node_modules"
    if not shutil.which("node") or not (where / ".bin/tsc").exists():
        pytest.skip("no generators of clients: run npm ci in tests/openapi")
    return where


def test_generated_clients(service, source, modules, tmp_path):
    def run(program, *words):
        done = subprocess.run([program, *words], cwd=here, capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    here = tmp_path / "clients"
    shutil.copytree(source / "tests/openapi/clients", here)
    (here / "node_modules").symlink_to(modules)
    (here / "openapi.json").write_bytes(service.get("/v1/openapi.json").body)
    run(modules / ".bin/openapi-typescript", "openapi.json", "--output", "schema.ts")
    run(modules / ".bin/openapi-ts", "--input", "openapi.json", "--output", "generated", "--logs", "logs")
    run(modules / ".bin/tsc", "--project", "tsconfig.json")
    for client in ("fetch", "sdk"):
        told = json.loads(run("node", f"out/{client}.js", f"http://{service.address}"))
        assert told == {"same_job": True, "outcome": "converged", "whole": True, "code": "spec_invalid",
                        "sphere": {"shape": "sphere", "center": [0.5, 0.5, 0.5], "radius": 1},
                        "names": ["points.ply", "report.json"]}
