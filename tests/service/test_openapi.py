# SPDX-License-Identifier: Apache-2.0
"""The OpenAPI document: it is linted, its examples work, and no answer is anything that it does not say."""
import json
import random
import re
import shutil
import subprocess

import pytest

from service import PATIENCE_S, sphere

jsonschema = pytest.importorskip("jsonschema", reason="no python3-jsonschema")
hypothesis = pytest.importorskip("hypothesis", reason="no python3-hypothesis")
from hypothesis import strategies as st  # noqa: E402

# generated requests
FEW, MANY = 30, pytest.param(120, marks=pytest.mark.extended)


@pytest.fixture(scope="module")
def described(build, tmp_path_factory):
    """A service on a Unix socket, with the document that it serves."""
    from service import Service

    where = tmp_path_factory.mktemp("openapi")
    service = Service(build, where, "--input_roots", where)
    for word in ("--listen", "--tcp_without_tokens"):
        at = service.options.index(word)
        del service.options[at:at + 2]
    service.start()
    subprocess.run([build / "hexad-worker", "make-example", where / "trefoil.vdb"], check=True)
    service.document = service.get("/v1/openapi.json").json
    service.closed = closed(service.document)
    yield service
    service.clean_up()


def operations(document):
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield method.upper(), path, operation


def closed(document):
    """The document, with schemas that take no further members: what answers have must be said, though clients are to
    take more. A schema that says `additionalProperties` is left as it is."""
    schemas = document["components"]["schemas"]

    def close(schema, part_of_another=False):
        if isinstance(schema, list):
            return [close(s) for s in schema]
        if not isinstance(schema, dict):
            return schema
        made = {name: [close(s, True) for s in part] if name == "allOf" else close(part) for name, part in schema.items()}
        said = schemas.get(schema["$ref"].rpartition("/")[2], {}) if "$ref" in schema else schema
        if said.get("type") == "object" and not part_of_another and "additionalProperties" not in said:
            made["unevaluatedProperties"] = False
        return made

    roots = {name: close(s, True) for name, s in schemas.items()}
    components = {**document["components"], "schemas": roots, "responses": close(document["components"]["responses"])}
    return {**document, "paths": close(document["paths"]), "components": components}


def validator(schema, document):
    return jsonschema.Draft202012Validator({**schema, "components": document["components"]})


def check_answer(document, operation, reply):
    """The answer has a status, a type and a body that the operation has among its responses."""
    said = operation["responses"].get(str(reply.status))
    assert said, f"{operation['operationId']} answered {reply.status}, which is not said: {reply.body[:500]}"
    if "$ref" in said:
        said = document["components"]["responses"][said["$ref"].rpartition("/")[2]]
    content = said.get("content")
    if not content:
        assert reply.body == b""
        return
    kind = (reply.headers["Content-Type"] or "").partition(";")[0]
    assert kind in content or "*/*" in content, (kind, operation["operationId"])
    if kind in content and "json" in kind:
        validator(content[kind]["schema"], document).validate(reply.json)


def expand(path, **values):
    return re.sub(r"\{(\w+)\}", lambda m: values[m.group(1)], path)


@pytest.mark.extended
def test_the_linter_is_content(described, source, tmp_path):
    lint = source / "tests/openapi/node_modules/.bin/redocly"
    if not shutil.which("node") or not lint.exists():
        pytest.skip("no linter: run npm ci in tests/openapi")
    file = tmp_path / "openapi.json"
    file.write_text(json.dumps(described.document))
    done = subprocess.run([lint, "lint", "--config", source / "tests/openapi/redocly.yaml", file],
                          capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout + done.stderr


def parts(schema, pointer=""):
    """(pointer, part) of all that a document has."""
    if isinstance(schema, (dict, list)):
        for name, part in schema.items() if isinstance(schema, dict) else enumerate(schema):
            yield f"{pointer}/{name}", part
            yield from parts(part, f"{pointer}/{name}")


@pytest.mark.parametrize("path", ["/v1/openapi.json", "/v1/schema.json"])
def test_a_known_document_is_not_sent_again(described, path):
    first = described.get(path)
    tag = first.headers["ETag"]
    assert first.status == 200 and tag and first.headers["Cache-Control"] == "no-cache"
    again = described.request("GET", path, headers={"If-None-Match": tag})
    assert (again.status, again.body, again.headers["ETag"]) == (304, b"", tag)
    assert described.request("GET", path, headers={"If-None-Match": '"another"'}).body == first.body


def test_the_document_is_made_of_the_tables(described, build):
    schema = json.loads(subprocess.run([build / "hexad-worker", "schema"], capture_output=True, check=True).stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert described.get("/v1/schema.json").json == schema
    ranks = {name: member["x-rank"] for name, member in schema["properties"]["sampling"]["properties"].items()}
    assert (ranks["count"], ranks["max_spacing"], ranks["control"]) == ("basic", "advanced", "research")
    schemas = described.document["components"]["schemas"]
    for name in ("Job", "Answered"):
        spec, surface = schemas[f"{name}Spec"], schemas[f"{name}Surface".removeprefix("Job")]
        assert spec["properties"].keys() == schema["properties"].keys()
        assert surface["properties"].keys() == schema["properties"]["surface"]["properties"].keys()
    names = [o["operationId"] for _, _, o in operations(described.document)]
    assert len(names) == len(set(names))


def test_what_is_sent_is_closed_and_what_is_answered_is_open(described):
    """Clients that are generated take members of a later version, and send none by mistake or because of a default."""
    schemas = described.document["components"]["schemas"]
    sent = {"JobSpec", "Surface", "JobPatch", "SignIn", "InspectionRequest"}
    bodies = {media["schema"]["$ref"].rpartition("/")[2] for _, _, operation in operations(described.document)
              for kind, media in operation.get("requestBody", {}).get("content", {}).items() if "json" in kind}
    assert bodies | {"Surface"} == sent
    for name, schema in schemas.items():
        for pointer, part in [("", schema), *parts(schema)]:
            if not isinstance(part, dict) or pointer.endswith("/properties"):
                continue
            where = f"{name}{pointer}"
            if "enum" in part or "const" in part:
                assert "type" in part, where
            if name in sent:
                assert part.get("type") != "object" or "additionalProperties" in part, where
                assert "default" not in part, where
            else:
                assert part.get("additionalProperties") is not False, where
                assert part.get("$ref", "").rpartition("/")[2] not in sent, where


def test_each_route_has_a_tag_and_an_example(described):
    document = described.document
    tags = [tag["name"] for tag in document["tags"]]
    used = set()
    for _, path, operation in operations(document):
        assert len(operation["tags"]) == 1 and operation["tags"][0] in tags
        used |= {*operation["tags"]}
        contents = [r["content"] for r in operation["responses"].values() if "content" in r]
        contents += [operation["requestBody"]["content"]] if "requestBody" in operation else []
        for kind, media in (pair for content in contents for pair in content.items()):
            if kind in ("*/*", "application/octet-stream"):
                continue  # files
            for example in media["examples"].values():
                if "$ref" in example:
                    example = document["components"]["examples"][example["$ref"].rpartition("/")[2]]
                validator(media["schema"], described.closed).validate(example["value"])
        for parameter in operation.get("parameters", []):
            assert parameter["in"] != "path" or "example" in parameter, path
    assert used == set(tags)


def test_every_example_works(described):
    done, job = 0, described.submit(sphere())
    for method, path, operation in operations(described.document):
        for kind, media in operation.get("requestBody", {}).get("content", {}).items():
            for example in media.get("examples", {}).values():
                validator(media["schema"], described.document).validate(example["value"])
                reply = described.request(method, expand(path, id=job), json.dumps(example["value"]),
                                          {"Content-Type": kind})
                if operation["operationId"] == "signIn":
                    assert reply.status == 401  # nobody has the token of an example
                else:
                    assert 200 <= reply.status < 300, reply.body
                check_answer(described.closed, operation, reply)
                done += 1
    assert done >= 6


def test_answers_of_a_job_that_succeeds(described):
    document = described.closed
    by_name = {o["operationId"]: (m, p, o) for m, p, o in operations(document)}
    job = described.submit(sphere(name="ball", queue={"labels": ["x"]}))
    described.wait_state(job, "succeeded")
    for name in ("getJob", "listResults", "cancelJob", "getResult", "listJobs", "getHealth", "getReadiness", "getVersion",
                 "getMetrics", "getOpenapi", "getSchema", "getUsage", "listWorkers", "listTokens", "getSession", "listFiles", "listTasks",
                 "listAttempts", "getLog", "getSnapshot", "followJob", "followJobs", "pauseJob", "resumeJob", "retryJob", "deleteJob",
                 "getJob"):
        method, path, operation = by_name[name]
        reply = described.request(method, expand(path, id=job, name="report.json"))
        assert reply.status < 500
        check_answer(document, operation, reply)


def test_an_unsaid_member_would_be_found(described):
    """Answers are compared with schemas that are closed here, and clients take what the open ones say."""
    job = described.job(described.submit(sphere()))
    page = {"jobs": [job], "next": None}
    opened, shut = (validator({"$ref": "#/components/schemas/JobPage"}, d) for d in (described.document, described.closed))
    assert opened.is_valid(page) and not shut.is_valid(page)  # a Job has more than a JobSummary
    opened, shut = (validator(d["paths"]["/v1/jobs/{id}"]["get"]["responses"]["200"]["content"]["application/json"]["schema"], d)
                    for d in (described.document, described.closed))
    shut.validate(job)
    for more in ({**job, "more": 1}, {**job, "tasks": {**job["tasks"], "more": 1}},
                 {**job, "spec": {**job["spec"], "more": 1}}, {**job, "links": {**job["links"], "more": 1}}):
        assert opened.is_valid(more) and not shut.is_valid(more)


def strategy_of(schema, document, inside=False):
    """What fits a schema, as far as the job's spec uses the language. A surface within a surface is a sphere: others
    would have surfaces in them without end."""
    if "$ref" in schema:
        if inside:
            return st.just(sphere()["surface"])
        name = schema["$ref"].rpartition("/")[2]
        return strategy_of(document["components"]["schemas"][name], document, name == "Surface")
    if "const" in schema:
        return st.just(schema["const"])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if "oneOf" in schema:
        return st.one_of([strategy_of(s, document, inside) for s in schema["oneOf"]])
    kind = schema.get("type")
    if kind == "boolean":
        return st.booleans()
    if kind == "integer":
        return st.integers(int(schema["minimum"]), int(min(schema["maximum"], 2**53)))
    if kind == "number":
        low = schema.get("minimum", schema.get("exclusiveMinimum"))
        return st.floats(low, schema["maximum"], exclude_min="exclusiveMinimum" in schema, allow_nan=False)
    if kind == "string":
        assert schema["pattern"] == r"^[^\x00]*$"
        return st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), min_size=int(schema["minLength"]), max_size=int(min(schema["maxLength"], 40)))
    if kind == "array":
        least = schema.get("minItems", 0)
        return st.lists(strategy_of(schema["items"], document, inside), min_size=least, max_size=schema.get("maxItems", least + 4))
    return objects(schema, document, inside)


@st.composite
def objects(draw, schema, document, inside):
    """Objects with what is required, one of each choice, and some of the rest."""
    properties = schema.get("properties", {})
    wanted, never = set(schema.get("required", [])), set()
    for part in schema.get("allOf", []):
        if "oneOf" in part:
            names = [p["required"][0] for p in part["oneOf"]]
            chosen = draw(st.sampled_from(names))
            wanted.add(chosen)
            never |= set(names) - {chosen}
        else:
            pair = part["not"]["required"]
            never.add(draw(st.sampled_from(pair)))
    free = sorted(set(properties) - wanted - never)
    wanted |= set(draw(st.lists(st.sampled_from(free), unique=True, max_size=3))) if free else set()
    return {name: draw(strategy_of(properties[name], document, inside)) for name in sorted(wanted)}


JUNK = st.recursive(st.none() | st.booleans() | st.integers(-3, 2**60) | st.floats(allow_nan=False, allow_infinity=False) |
                    st.text(max_size=5), lambda inner: st.lists(inner, max_size=3) |
                    st.dictionaries(st.text(max_size=5), inner, max_size=3), max_leaves=5)


def mutate(draw, document):
    """Puts something else at a random place."""
    here, key = {"": document}, ""
    while isinstance(here[key], (dict, list)) and here[key] and draw(st.integers(0, 3)):
        here, key = here[key], draw(st.sampled_from(sorted(here[key]) if isinstance(here[key], dict) else
                                                    range(len(here[key]))))
    if here.keys() == {""} if isinstance(here, dict) else False:
        return draw(JUNK)
    here[key] = draw(JUNK)
    return document


def new_seed():
    seed = random.SystemRandom().randrange(2**32)
    print(f"seed {seed}")  # shown when the test fails
    return seed


@pytest.mark.parametrize("count", [FEW, MANY])
def test_generated_specs(described, new_service, count):
    """What fits the schema is valid or refused with a reason; what does not fit is refused; nothing breaks."""
    document = described.document
    service = new_service("--estimate_timeout_s", "0.1").start()
    operation = described.closed["paths"]["/v1/jobs:validate"]["post"]
    good = validator({"$ref": "#/components/schemas/JobSpec"}, document)
    specs = strategy_of({"$ref": "#/components/schemas/JobSpec"}, document)

    @hypothesis.seed(new_seed())
    @hypothesis.settings(max_examples=count, deadline=None, database=None,
                         suppress_health_check=list(hypothesis.HealthCheck))
    @hypothesis.given(st.data())
    def run(data):
        spec = data.draw(specs)
        if data.draw(st.booleans()):
            spec = mutate(data.draw, spec)
        reply = service.post("/v1/jobs:validate", raw=json.dumps(spec))
        assert reply.status in (200, 403, 422) or "\\u0000" in json.dumps(spec) and reply.status == 400, reply.body
        check_answer(described.closed, operation, reply)
        if not good.is_valid(spec):
            assert reply.status in (400, 422), f"{spec} does not fit the schema and was taken"
        if reply.status == 200:
            again = service.post("/v1/jobs:validate", {**reply.json["spec"]})
            if again.status == 200:
                assert all(again.json[part] == reply.json[part] for part in ("spec", "paths"))
            else:
                assert not reply.json["estimate"]  # the worker's look was in time for a fault only now

    run()


@pytest.mark.parametrize("count", [3 * FEW, MANY])
def test_generated_requests(described, count):
    """Any path, query, header and body: no answer is a fault of the service or unlike the document."""
    document = described.closed
    every = list(operations(document))
    plain = st.text("0123456789abcdefXYZ-_.~%+*\"'<>", min_size=1, max_size=30)
    word = st.one_of(plain, st.from_regex(r"\A[0-9a-z]{26}\Z"), st.from_regex(r"\A[0-9a-f]{64}\Z"))
    value = st.one_of(plain, st.integers(-5, 10**20).map(str), st.sampled_from(["queued", "failed", ""]))

    @hypothesis.seed(new_seed())
    @hypothesis.settings(max_examples=count, deadline=None, database=None,
                         suppress_health_check=list(hypothesis.HealthCheck))
    @hypothesis.given(st.data())
    def run(data):
        method, path, operation = data.draw(st.sampled_from(every))
        names = [p["name"] for p in operation.get("parameters", []) if p["in"] == "query"] + ["other"]
        target = expand(path, **{n: data.draw(word).replace("%", "%25") for n in re.findall(r"\{(\w+)\}", path)})
        pairs = data.draw(st.lists(st.tuples(st.sampled_from(names), value), max_size=3))
        query = "&".join(f"{k}={v.replace('%', '%25').replace('+', '%2B')}" for k, v in pairs)
        headers = data.draw(st.dictionaries(st.sampled_from(["Range", "If-None-Match", "If-Range", "Content-Type", "Prefer",
                                                             "Last-Event-ID", "Idempotency-Key", "If-Match"]),
                                            st.one_of(plain, st.just("application/json")), max_size=3))
        body = data.draw(st.one_of(st.none(), st.binary(max_size=50), st.just(b"{}"))) if method != "GET" else None
        reply = described.request(method, target + ("?" + query if query else ""), body, headers)
        assert reply.status < 500 or (reply.status == 503 and path in ("/readyz", "/v1/jobs")), (method, target, reply.body)
        check_answer(document, operation, reply)

    run()
    described.post("/v1/admin/resume")


def test_metrics_are_what_prometheus_reads(described):
    reply = described.get("/metrics")
    assert reply.status == 200 and b'hexad_http_answers_total{class="2xx"}' in reply.body


@pytest.mark.extended
def test_promtool_accepts_the_metrics(described):
    reply = described.get("/metrics")
    tool = shutil.which("promtool")
    if not tool:
        pytest.skip("no promtool (Debian: prometheus)")
    done = subprocess.run([tool, "check", "metrics"], input=reply.body, capture_output=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout + done.stderr
