# SPDX-License-Identifier: Apache-2.0
# What bootcheck and packagecheck share: a bare Debian, and a boot of a tree in which a script runs as root. To be sourced.

skip_all() {
    echo "1..0 # SKIP $*"
    exit 77
}

# needs_root TOOL...
needs_root() {
    [ "$(id -u)" -eq 0 ] || skip_all "needs root, to boot a container"
    for tool in "$@"; do
        command -v "$tool" >/dev/null || skip_all "$tool is not installed"
    done
}

# make_base DIRECTORY PACKAGES: with these packages, separated by commas; kept for the next time
make_base() {
    [ ! -e "$1.done" ] || return 0
    rm -rf "$1"
    mkdir -p "$(dirname "$1")"
    debootstrap --variant=minbase --include="$2" "${DEBIAN_SUITE:-$(. /etc/os-release && echo "$VERSION_CODENAME")}" "$1" \
        ${DEBIAN_MIRROR:-} >"$1.log" 2>&1 || {
        tail -n 5 "$1.log"
        skip_all "no base system could be made (see $1.log)"
    }
    touch "$1.done"
}

# run_at_boot TREE COMMAND TAP TRACE: what the command prints goes to these files of the booted system, which then ends
run_at_boot() {
    cp "$(dirname "$0")/../boot/tap.sh" "$1/root/tap.sh"
    echo hexad-bootcheck >"$1/etc/hostname"
    echo "127.0.0.1 localhost hexad-bootcheck" >"$1/etc/hosts"
    cat >"$1/etc/systemd/system/checks.service" <<UNIT
[Unit]
After=multi-user.target
[Service]
Type=oneshot
ExecStart=$2
StandardOutput=file:$3
StandardError=file:$4
TimeoutStartSec=1200
ExecStopPost=/bin/systemctl --no-block poweroff
[Install]
WantedBy=default.target
UNIT
    systemctl --quiet --root="$1" enable checks.service
    systemctl --quiet --root="$1" set-default multi-user.target
}

# boot_tree TREE CONSOLE: in a container without a network, whose own filter has no room for the calls of workers' sandboxes
boot_tree() {
    timeout 600 systemd-nspawn --quiet --boot --register=no --keep-unit --private-network --directory="$1" \
        --system-call-filter="landlock_create_ruleset landlock_add_rule landlock_restrict_self" \
        --machine=hexad-bootcheck </dev/null >"$2" 2>&1 || true
}

# judge TAP TRACE CONSOLE: prints the TAP; what else was said, where something has failed
judge() {
    [ -s "$1" ] || {
        tail -n 20 "$3"
        skip_all "the system did not boot (see $3)"
    }
    cat "$1"
    if grep -q '^not ok' "$1" || ! grep -q '^1\.\.' "$1"; then
        cat "$2"
        exit 1
    fi
}
