# SPDX-License-Identifier: Apache-2.0
# What packagecheck runs in the booted system, as root. TAP on standard output.
set -u
export DEBIAN_FRONTEND=noninteractive
cd /root || exit
. /root/tap.sh

spec() {
    echo "{\"version\": 1, \"surface\": {\"analytic\": {\"shape\": \"sphere\", \"center\": [0, 0, 0], \"radius\": $1}},
        \"sampling\": {\"count\": $2}, \"solver\": {$3}}"
}
submit_long() {
    spec 1 20000 '"max_sweeps": 1000000, "step_tolerance": 1e-12, "energy_tolerance": 1e-12' | hexadctl submit -
}
state_is() { hexadctl show "$1" | grep -q " $2"; }
main_pid() { systemctl show -P MainPID hexad.service; }
install() { apt-get install -y --no-install-recommends "$@"; }

# All files that a purge is to take away again; without what apt, dpkg, systemd and the log keep for themselves.
files() {
    find / -xdev \( -path /proc -o -path /sys -o -path /run -o -path /tmp -o -path /root -o -path /srv -o -path /var/cache \
        -o -path /var/log -o -path /var/lib/apt -o -path /var/lib/dpkg -o -path /var/lib/systemd -o -path /var/tmp \) -prune -o -print |
        sort
}

is_enabled() {
    systemctl enable --now hexad.socket && systemctl is-enabled hexad.service hexad.socket && systemctl is-active hexad.socket
}
runs_a_job() { spec 2 500 "" | hexadctl submit - --wait; }
runs_a_job_of_python() {
    python3 -c '
import hexad
job = hexad.Client().submit({"version": 1, "surface": {"analytic": {"shape": "sphere", "radius": 3}}, "sampling": {"count": 500}},
                            wait=True)
assert job.outcome == "converged" and job.points().count == 500'
}

# The page and the API on the port, with the token that the command prints.
opens_the_port() {
    hexad --open-port nobody >opened && cat opened && systemctl is-active hexad.service && python3 -c '
import sys, urllib.request
token = sys.stdin.readline().strip()
page = urllib.request.urlopen("http://127.0.0.1:8642/").read()
assert b"<title>hexad" in page, page[:200]
jobs = urllib.request.Request("http://127.0.0.1:8642/v1/jobs", headers={"Authorization": "Bearer " + token})
assert urllib.request.urlopen(jobs).status == 200' <opened && hexadctl list
}

# As if an earlier build had been installed by hand: its state, and no more.
takes_over_a_state() {
    systemctl stop hexad.socket hexad.service
    rm -rf /var/lib/hexad/*
    cp -r /srv/state/. /var/lib/hexad
    chown -R hexad:hexad /var/lib/hexad
    systemctl start hexad.socket
    hexadctl list | tee list && [ "$(grep -c . list)" = 14 ] &&
        sent=$(awk '/  sent$/ { print $1 }' list) && hexadctl fetch "$sent" --output sent && test -s sent/points.ply &&
        until_true sh -c "hexadctl list | grep '  runs$' | grep -q succeeded"
}

is_upgraded() {
    printf 'drain_s = 1\n' >>/etc/hexad.conf
    systemctl restart hexad.service
    job=$(submit_long) && until_true state_is "$job" running || return 1
    daemon=$(main_pid)
    install /srv/new/*.deb && [ "$(main_pid)" -gt 0 ] && [ "$(main_pid)" != "$daemon" ] && grep -q '^drain_s = 1' /etc/hexad.conf &&
        until_true state_is "$job" running && hexadctl cancel "$job" && until_true state_is "$job" cancelled &&
        ! dpkg-query -W -f '${Version}\n' hexad | grep earlier && dpkg -S /usr/bin/hexad-worker | grep '^hexad-worker:'
}

# "command -v" would print the path of a program that this shell has run, also when it is gone.
# A host of a farm has the worker alone, and none of the libraries that only the daemon needs.
works_without_the_daemon() {
    apt-mark manual hexad-worker && apt-get remove -y hexad && apt-get autoremove -y && ! test -e /usr/bin/hexad &&
        spec 2 500 "" | hexad-worker run - --output worker && test -s worker/points.ply && hexad-node --version &&
        ! dpkg-query -W -f '${Depends}\n' hexad-worker | grep -E 'microhttpd|sqlite|curl|systemd|inih' &&
        ! ldd /usr/bin/hexad-worker /usr/bin/hexad-node | grep -E 'microhttpd|sqlite|curl|systemd|inih' &&
        install /srv/new/hexad_*.deb
}

is_removed() {
    apt-get remove -y hexad hexad-client && ! systemctl is-active hexad.service && ! systemctl is-active hexad.socket &&
        ! test -e /usr/bin/hexad && test -f /etc/hexad.conf && test -f /var/lib/hexad/queue.db
}
comes_back() {
    install /srv/new/*.deb && hexadctl list | tee list && [ "$(grep -c . list)" -ge 15 ] && grep -q '^drain_s = 1' /etc/hexad.conf
}

# Left are the user and what others keep of it.
is_purged() {
    apt-get purge -y hexad hexad-worker hexad-client python3-hexad libhexad1 libhexad-dev hexad-doc && apt-get autoremove --purge -y && files >after
    comm -13 before after >left
    cat left
    ! grep hexad left && ! find / -xdev -path /root -prune -o -path /srv -prune -o -path /var/log -prune -o -name '*hexad*' -print |
        grep . && getent passwd hexad && [ -z "$(systemctl --failed -q --plain)" ]
}

passes_its_own_test() {
    install autopkgtest curl python3-numpy && autopkgtest --log-file=autopkgtest.log /srv/new/*.deb /srv/source -- null
}

files >before
check "the packages are installed" install /srv/earlier/*.deb
check "socket and service are enabled" is_enabled
check "a job by hexadctl" runs_a_job
check "a job by Python" runs_a_job_of_python
check "the port is opened with a first token" opens_the_port
check "the state of an earlier build is taken over" takes_over_a_state
check "an upgrade goes on with running jobs and keeps settings" is_upgraded
check "hexad-worker works without the daemon" works_without_the_daemon
check "a removal ends the service and keeps settings and state" is_removed
check "an installation finds them again" comes_back
check "a purge leaves nothing but the user" is_purged
check "autopkgtest" passes_its_own_test
echo "1..$count"
