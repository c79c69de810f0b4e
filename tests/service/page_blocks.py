# SPDX-License-Identifier: Apache-2.0
"""Blocks of shell of a page, and what the page shows of their output."""
import re

NUMBER_OR_NAME = r".*"  # the text that `...` in an output replaces


def blocks(page):
    """(mark, commands, output) of each block of shell: the mark behind ```sh, such as `daemon` or `fails`; the output is that of a block
    ```output that follows, or is empty."""
    return re.findall(r"^```sh *([\w-]*)\n(.*?)^```\n(?:\n```output\n(.*?)^```$)?", page, re.M | re.S)


def missing_lines(output, printed):
    """Lines of an output in a page that the commands did not print. Their order is that of standard output and standard error apart."""
    lines = printed.splitlines()
    return [line for line in output.splitlines()
            if not any(re.fullmatch(NUMBER_OR_NAME.join(map(re.escape, line.split("..."))), found) for found in lines)]
