#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# fragments: writes build-aux/files.mk, the lists of files that Makefile.am includes. ./bootstrap runs it.
#
#   tools/fragments.sh            writes the file if a list has changed
#   tools/fragments.sh --print    prints it
#
# It needs a shell, find, sort and awk only. The lists are:
#
#   src_FOLDER              C and C++ files of src/FOLDER (io/meshes: src_io_meshes) and of the folders below it that have no
#                           Makefile.inc. A file that Makefile.inc names itself is left out. This does not hold for the files
#                           that a unit test or a module (_so_SOURCES) compiles a second time.
#   unit_tests              tests/unit/test_*.c, unless a Makefile.inc puts the test into a list itself
#   daemon_tests            those that include a header of src/service or src/client: they are linked with libservice.a
#   test_NOUN_files         the files of tests/unit that test_NOUN.c is compiled of: it, and the fixtures that it includes
#   longest_tests, ...      files of pytest by their markers: a file is in each list that one of its tests belongs to. The
#                           files of tests/longest.txt are first.
#   page_files, ...         files of the page and of the Python client that are installed, and files for the tarball only
#
# It also writes what a unit test is linked with, unless Makefile.inc does: libvolume.a if the test includes a header of a
# folder whose list is in libvolume_a_SOURCES. Last are the include lines of all Makefile.inc.
set -eu
cd "$(dirname "$0")/.."

lists() {
    find clients doc examples fuzz measurements page src tests tools \
        \( -name node_modules -o -name __pycache__ -o -name '.*' \) -prune -o -type f -print 2>/dev/null | LC_ALL=C sort | awk '
function folder_of(name) { sub(/\/[^\/]*$/, "", name); return name }

# the folder with the Makefile.inc of a file of src; empty if there is none
function part_of(name) {
    do name = folder_of(name); while (name ~ /\// && !(name in is_part))
    return name in is_part ? name : ""
}

function variable_of(folder) { gsub(/[\/-]/, "_", folder); return folder }

function add(list, name) { lists[list] = lists[list] " \\\n\t" name }

function print_list(list) { print list " =" lists[list] }

# reads which files and tests a Makefile.inc puts into lists itself
function read_part(folder,    file, line, more, word, n, i, name) {
    file = folder "/Makefile.inc"
    while ((getline line < file) > 0) {
        while (sub(/\\$/, "", line) && (getline more < file) > 0) line = line more
        if (line !~ /^[A-Za-z0-9_]+ \+?=/) continue
        n = split(line, word, /[ \t]+/)
        if (word[1] ~ /^tests_unit_/) is_written[word[1]] = 1
        for (i = 3; i <= n; i++) {
            name = word[i]
            if (word[1] ~ /_tests$/) is_named[name ".c"] = 1
            else if (word[1] !~ /^tests_unit_|_so_SOURCES$/ && sub(/^%D%/, folder, name)) is_named[name] = 1
            if (word[1] == "libvolume_a_SOURCES" && name ~ /^\$\(src_/) is_volume[folder] = 1
        }
    }
    close(file)
}

# follows the includes of a unit test: collects its files, and what it is linked with
function read_test(file,    line, word, stem, part) {
    if (is_seen[file] == test) return
    is_seen[file] = test
    add(test "_files", file)
    while ((getline line < file) > 0) {
        if (line !~ /^#include "/) continue
        split(line, word, "\"")
        stem = "tests/unit/" word[2]
        if (stem in is_there) {
            read_test(stem)
            sub(/\.h$/, "", stem)
            if ((stem ".c") in is_there) read_test(stem ".c")
            if ((stem ".cc") in is_there) read_test(stem ".cc")
        } else if (word[2] ~ /^(service|client)\//) {
            is_daemon[test] = 1
        } else if ((part = part_of("src/" word[2])) in is_volume) {
            needs_volume[test] = 1
        }
    }
    close(file)
}

function print_test(    name) {
    name = "tests_unit_" test
    if (lists[test "_files"] ~ /\n.*\n/ || (name "_SOURCES") in is_written) print_list(test "_files")
    if (lists[test "_files"] ~ /\n.*\n/ && !((name "_SOURCES") in is_written)) print name "_SOURCES = $(" test "_files)"
    if ((name "_LDADD") in is_written) return
    if (test in is_daemon) {
        print name "_LDADD = $(SERVICE_LDADD) $(CMOCKA_LIBS)"
    } else if (test in needs_volume) {
        print name "_LDADD = $(volume_ldadd)"
        print "nodist_EXTRA_" name "_SOURCES = dummy.cc"
    }
}

# finds the tiers of a file of pytest; a test without the marker extended, and without the shared data, is basic
function read_pytest(file,    line, is_extended, module_is_extended) {
    is_extended = 0
    module_is_extended = 0
    while ((getline line < file) > 0) {
        if (line ~ /mark\.sanitized/) tier[file, "sanitized"] = 1
        if (line ~ /mark\.campaign/) tier[file, "campaign"] = 1
        if (line ~ /mark\.extended|shared_data/) tier[file, "extended"] = 1
        if (line ~ /^pytestmark.*mark\.extended/) module_is_extended = 1
        if (line ~ /^[ \t]*@pytest\.mark\.extended/) is_extended = 1
        if (line ~ /^[ \t]*def /) {
            if (line ~ /^[ \t]*def test_/ && !is_extended && !module_is_extended && line !~ /shared_data/) tier[file, "basic"] = 1
            is_extended = 0
        }
    }
    close(file)
    if ((file, "campaign") in tier) delete tier[file, "extended"]
}

function add_pytest(file, is_long) {
    if ((file, "basic") in tier) add(is_long ? "longest_tests" : "other_tests", file)
    if ((file, "sanitized") in tier) add("sanitized_tests", file)
    if ((file, "extended") in tier) add("extended_tests", file)
    if ((file, "campaign") in tier) add("campaign_tests", file)
}

{ path[++paths] = $0; is_there[$0] = 1 }

END {
    print "# Written by tools/fragments.sh, which ./bootstrap runs."
    for (i = 1; i <= paths; i++)
        if (path[i] ~ /^src\/.*\/Makefile\.inc$/) {
            is_part[folder_of(path[i])] = 1
            read_part(folder_of(path[i]))
        }

    for (i = 1; i <= paths; i++)
        if (path[i] ~ /^src\/.*\.(c|h|cc)$/ && !(path[i] in is_named)) {
            if (!(part = part_of(path[i]))) {
                print "fragments: " path[i] ": there is no Makefile.inc in its folder or above it" >"/dev/stderr"
                failed = 1
            }
            add(variable_of(part), path[i])
        }
    for (i = 1; i <= paths; i++)
        if (path[i] ~ /^src\/.*\/Makefile\.inc$/) print_list(variable_of(folder_of(path[i])))

    unit = "unit_tests +="
    daemon = "daemon_tests +="
    for (i = 1; i <= paths; i++)
        if (path[i] ~ /^tests\/unit\/test_[^\/]*\.c$/) {
            test = path[i]
            sub(/.*\//, "", test)
            sub(/\.c$/, "", test)
            read_test(path[i])
            print_test()
            if (path[i] in is_named) continue
            if (test in is_daemon) daemon = daemon " \\\n\ttests/unit/" test
            else unit = unit " \\\n\ttests/unit/" test
        }
    print unit
    print daemon

    for (i = 1; i <= paths; i++)
        if (path[i] ~ /^tests\/(.*\/)?test_[^\/]*\.py$/) read_pytest(path[i])
    while ((getline line <"tests/longest.txt") > 0) {
        if (line ~ /^#|^$/) continue
        if (!(("tests/" line) in is_there)) {
            print "fragments: tests/longest.txt names tests/" line ", which is nowhere" >"/dev/stderr"
            failed = 1
        }
        add_pytest("tests/" line, 1)
        is_long["tests/" line] = 1
    }
    for (i = 1; i <= paths; i++)
        if (!(path[i] in is_long)) add_pytest(path[i], 0)

    for (i = 1; i <= paths; i++) {
        if (path[i] ~ /^page\/(preact|sha256|uplot)\./) continue  # copies of libraries in a build in the source tree
        if (path[i] ~ /^page\/[^\/]*\.(html|css|svg|js)$/) add("page_files", path[i])
        else if (path[i] ~ /^clients\/python\/hexad\/([^\/]*\.py|py\.typed)$/) add("python_client_files", path[i])
        else if (path[i] ~ /^(doc\/[^\/]*\.(md|png)|examples\/[^\/]*\.(c|json)|fuzz\/[^\/]*\.(py|dict)|tools\/[^\/]*\.(py|sh))$/ ||
            path[i] ~ /^tests\/([^\/]*\/)?[^\/]*\.(h|json|js|md|mjs|py|sh|ts|tsv|txt|yaml)$/ || path[i] ~ /^tests\/[^\/]*\.c$/ ||
            path[i] ~ /^measurements\/.*(\.(md|csv|json|py|sh|png|svg)|\/reproduce)$/)
            add("distributed_files", path[i])
    }
    split("longest_tests other_tests sanitized_tests extended_tests campaign_tests page_files python_client_files " \
        "distributed_files", names, " ")
    for (i = 1; i in names; i++) print_list(names[i])

    for (i = 1; i <= paths; i++)
        if (path[i] ~ /^(src|measurements)\/.*\/Makefile\.inc$/) print "include $(srcdir)/" path[i]
    exit failed
}'
}

new=$(lists)
if [ "${1:-}" = --print ]; then
    printf '%s\n' "$new"
elif [ ! -f build-aux/files.mk ] || [ "$new" != "$(cat build-aux/files.mk)" ]; then
    mkdir -p build-aux
    printf '%s\n' "$new" >build-aux/files.mk.new
    mv build-aux/files.mk.new build-aux/files.mk
fi
