#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The manual pages, from what the programs say of themselves: doc/man/*, which `make man` writes.

    man.py BUILD OUTPUT STATE SETTINGS    BUILD holds the built programs, OUTPUT becomes the directory of the pages, STATE
                                          and SETTINGS are configure's localstatedir and sysconfdir, which the pages have
                                          marks for

A help text is made of blocks between empty lines: the usage; lists, whose lines are indented; paragraphs; and one
that begins with "Exit". hexad.conf(5) is the list of settings at the end of `hexad --help all`, with a heading for each
rank. What no help text has is in PAGES.
"""
import collections
import pathlib
import re
import subprocess
import sys

DATE = "2026-11-22"
SETTINGS = "Settings, as options and as keys of the file"

PAGES = {
    "hexad": {
        "section": 8, "about": "daemon that samples implicit surfaces",
        "more": [
            ("FILES", [("@sysconfdir@/hexad.conf", "settings, read when the unit or --config says so"),
                       ("/etc/hexad/tokens", "tokens of the service that systemd runs, which hexadctl token writes;"
                        " they hold at once"),
                       ("@localstatedir@/lib/hexad", "queue, attempts and results"),
                       ("@docdir@/examples", "drop-ins for the units: tcp.conf serves a port, webhooks.conf lets the"
                        " service call webhooks, mounts.conf ties it to a mount, memory.conf has the kernel keep memory"
                        " limits, slurm.conf lets it call Slurm; also alert rules for Prometheus and a dashboard for Grafana")]),
            ("ENVIRONMENT", [("NOTIFY_SOCKET, WATCHDOG_USEC, LISTEN_FDS, RUNTIME_DIRECTORY, STATE_DIRECTORY,"
                              " CONFIGURATION_DIRECTORY, JOURNAL_STREAM",
                              "set by systemd: where to report that the service is ready and alive, the socket to serve,"
                              " where it is otherwise made, where to keep the state, where the file tokens is, and whether the log goes to"
                              " the journal, with the fields HEXAD_JOB, HEXAD_ATTEMPT and HEXAD_WORKER"),
                             ("MALLOC_ARENA_MAX", "number of arenas in which the C library allocates memory; 4 unless it is set."
                              " More arenas keep more freed memory")]),
        ],
        "see": "hexad.conf(5), hexadctl(1), hexad-worker(1); the page for administrators, operations.md (package hexad-doc:"
               " /usr/share/doc/hexad-doc/doc)"},
    "hexad-worker": {"section": 1, "about": "samples one implicit surface", "more": [], "see": "hexad(8), hexadctl(1)"},
    "hexadctl": {
        "section": 1, "about": "client of hexad",
        "more": [("ENVIRONMENT", [("HEXAD_SERVER", "the server, where --server does not say it"),
                                  ("HEXAD_TOKEN", "a token to be shown to the server"),
                                  ("SSL_CERT_FILE", "certificates that the server's may be signed with")]),
                 ("FILES", [("/etc/hexad/tokens", "tokens of the service that systemd runs: of root, and readable to the"
                             " group hexad")])],
        "see": "hexad(8), hexad-worker(1)"},
}


def escaped(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return re.sub(r"^(?=[.'])", r"\\&", text, flags=re.M)


def say(program, *words):
    text = subprocess.run([program, *words], check=True, capture_output=True, text=True).stdout
    return text.replace(f"{sys.argv[3]}/", "@localstatedir@/").replace(f"{sys.argv[4]}/hexad.conf", "@sysconfdir@/hexad.conf")


def blocks_of(text):
    return [block.rstrip().split("\n") for block in re.split(r"\n\s*\n", text.strip("\n"))]


def column_of(lines):
    """The column at which texts of lists begin; None: all are on lines of their own."""
    gaps = [m.end() for m in (re.match(r"  \S.*?\s{2,}(?=\S)", line) for line in lines) if m]
    return collections.Counter(gaps).most_common(1)[0][0] if gaps else None


def items_of(lines, column=None):
    """(term, text) of an indented list; texts begin at the column, or on the next line. Lines indented by less continue a
    term."""
    items = []
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if indent > 2:
            term, text = items[-1]
            if column and indent < column:
                items[-1] = (f"{term} {line.strip()}", text)
            else:
                text.append(line.strip())
            continue
        split = column and len(line) > column and line[column - 2:column] == "  "
        if column and not split and line.startswith("  --") and len(re.findall(" [a-z]+", line)) > 1:
            sys.exit(f"man.py: write two spaces, or a new line, between the option and its text: {line.strip()}")
        term, text = (line[:column], line[column:]) if split else (line, "")
        items.append((term.strip(), [text.strip()]))
    return [(term, " ".join(filter(None, text))) for term, text in items]


def listed(items):
    return "".join(f".TP\n.B {escaped(term)}\n{escaped(text)}\n".replace("\n\n", "\n") for term, text in items)


def header(name, section, about, version):
    version = version.replace("~", "\\(ti")  # a plain ~ is an accent for groff
    return (f'.\\" Written by tools/man.py from what the programs say; `make man` writes it anew.\n'
            f'.TH {name.upper()} {section} {DATE} "{version}"\n.ad l\n.nh\n.SH NAME\n{escaped(name)} \\- {about}\n')


def page_of(name, program):
    facts = PAGES[name]
    help_text = say(program, "--help", "all").partition("\n" + SETTINGS)[0]
    usage, *rest = blocks_of(help_text)
    column = column_of(help_text.split("\n"))
    calls = [re.sub(r"^usage:", "", line).strip() for line in usage]
    out = header(name, facts["section"], facts["about"], say(program, "--version").strip())
    out += ".SH SYNOPSIS\n.nf\n" + "".join(f"{escaped(call)}\n" for call in calls) + ".fi\n.SH DESCRIPTION\n"
    status = ""
    for block in rest:
        if block[0].startswith("Exit"):
            status = ".SH EXIT STATUS\n" + escaped(re.sub(r"^Exit [a-z]+: ", "", " ".join(block))) + "\n"
        elif block[0].startswith("  "):
            out += listed(items_of(block, column))
        else:
            out += ("" if out.endswith("DESCRIPTION\n") else ".PP\n") + escaped(" ".join(block)) + "\n"
    out += status
    for title, items in facts["more"]:
        out += f".SH {title}\n" + listed(items)
    return out + f".SH SEE ALSO\n{escaped(facts['see'])}\n"


def settings_page(program):
    first, *blocks = blocks_of(say(program, "--help", "all").partition("\n" + SETTINGS)[2])
    out = header("hexad.conf", 5, "settings of hexad", say(program, "--version").strip())
    out += (".SH DESCRIPTION\nA line is a setting,\n.IR \"key \" = \" value\" ,\nor a comment after # or ;. A colon may take the place of =. Each is an"
            " option of\n.BR hexad (8)\nas well, which wins over the file. A setting that is not there has its default.\n"
            + escaped(" ".join(first).partition("precedence. ")[2]) + ".\n")
    for block in blocks:
        if block[0].startswith("  "):
            ((term, prose),) = items_of(block)
            out += listed([(term.removeprefix("--"), prose)])
        else:
            out += f".SH {block[0].upper()}\n"
    return out + ".SH SEE ALSO\nhexad(8)\n"


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    build, output = (pathlib.Path(word).resolve() for word in sys.argv[1:3])
    output.mkdir(parents=True, exist_ok=True)
    for name, facts in PAGES.items():
        (output / f"{name}.{facts['section']}").write_text(page_of(name, build / name))
    (output / "hexad.conf.5").write_text(settings_page(build / "hexad"))


if __name__ == "__main__":
    main()
