# SPDX-License-Identifier: Apache-2.0
"""nginx and stunnel in front of the service, with the configuration that the project ships."""
import http.client
import json
import os
import shutil
import socket
import ssl
import subprocess

import pytest

from service import PATIENCE_S, wait_until

PLACES = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/usr/bin"))
NGINX = """daemon off;
%(user)spid %(where)s/nginx.pid;
error_log stderr;
events {}
http {
    access_log off;
    client_body_temp_path %(where)s/body;
    proxy_temp_path %(where)s/proxy;
    fastcgi_temp_path %(where)s/fastcgi;
    uwsgi_temp_path %(where)s/uwsgi;
    scgi_temp_path %(where)s/scgi;
    include %(where)s/hexad.conf;
}
"""
STUNNEL = """foreground = yes
pid =
debug = warning
"""


def program(name):
    found = shutil.which(name, path=PLACES)
    if not found:
        pytest.skip(f"{name} is not installed")
    return found


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    """A directory with certificate.pem and key.pem, for localhost and 127.0.0.1."""
    where = tmp_path_factory.mktemp("certificate")
    subprocess.run([program("openssl"), "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                    "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1",
                    "-keyout", where / "key.pem", "-out", where / "certificate.pem"], check=True, capture_output=True,
                   timeout=PATIENCE_S)
    return where


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Front:
    """nginx or stunnel in front of an address, with the configuration that the project ships; asked like a service."""

    def __init__(self, kind, source, certificate, where, behind, prefix="/"):
        self.certificate, self.port = certificate, free_port()
        self.address = f"localhost:{self.port}"
        text = (source / "etc" / f"{kind}.conf").read_text()
        port = f"127.0.0.1:{self.port}"
        for shipped, here in (("listen 443", f"listen {port}"), ("accept = 443", f"accept = {port}"),
                              ("127.0.0.1:8642", behind), ("/etc/ssl/hexad", str(certificate))):
            text = text.replace(shipped, here)
        if prefix != "/":  # the two lines that doc/systemd.md names
            text = text.replace("location / {", f"location {prefix} {{").replace(f"http://{behind};", f"http://{behind}/;")
        where.mkdir()
        if kind == "nginx":
            (where / "hexad.conf").write_text(text)
            user = "user root;\n" if os.geteuid() == 0 else ""
            (where / "nginx.conf").write_text(NGINX % {"where": where, "user": user})
            words = [program("nginx"), "-p", where, "-c", where / "nginx.conf"]
        else:
            (where / "stunnel.conf").write_text(STUNNEL + text)
            words = [program("stunnel4"), where / "stunnel.conf"]
        self.log = where / "log"
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(words, stdout=log, stderr=log, stdin=subprocess.DEVNULL)
        wait_until(self.answers, f"{kind}: {self.log.read_text()}")

    def answers(self):
        assert self.process.poll() is None, self.log.read_text()
        with socket.socket() as s:
            return s.connect_ex(("127.0.0.1", self.port)) == 0

    def connection(self, source="127.0.0.1"):
        trusted = ssl.create_default_context(cafile=str(self.certificate / "certificate.pem"))
        return http.client.HTTPSConnection("localhost", self.port, timeout=PATIENCE_S, context=trusted,
                                           source_address=(source, 0))

    def ask(self, token, method, path, body=None, source="127.0.0.1", **headers):
        connection = self.connection(source)
        headers = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, body, {"Authorization": f"Bearer {token}", **headers})
        reply = connection.getresponse()
        reply.body = reply.read()
        connection.close()
        return reply

    def submit(self, token, spec):
        reply = self.ask(token, "POST", "/v1/jobs", json.dumps(spec), Content_Type="application/json")
        assert reply.status == 201, reply.body
        return json.loads(reply.body)["id"]

    def end(self):
        self.process.terminate()
        self.process.wait(PATIENCE_S)
