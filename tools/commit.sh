#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# commit.sh SOURCE: prints the commit of the sources in the folder SOURCE. In a clone git names it; if src or the files of the build differ
# from the commit, a hash of the difference follows. In a tarball the file build-aux/commit names it. Without both it prints nothing.
cd "$1" || exit
if [ -e .git ] && commit=$(git rev-parse HEAD 2>/dev/null); then
    git diff --quiet HEAD -- src configure.ac Makefile.am 2>/dev/null ||
        commit=$commit-$(git diff HEAD -- src configure.ac Makefile.am | git hash-object --stdin)
    echo "$commit"
elif [ -r build-aux/commit ]; then
    cat build-aux/commit
fi
