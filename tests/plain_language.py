# SPDX-License-Identifier: Apache-2.0
"""Phrases that comments, messages and pages must not contain, and what to write instead.

`python3 tests/plain_language.py [FOLDER...]` prints each match as FILE:LINE: PHRASE: INSTEAD, and the number of matches
in each folder. tests/test_source_tree.py fails if there is one outside of EXCEPTIONS.
"""
import collections
import functools
import io
import pathlib
import re
import subprocess
import sys
import tokenize

FOLDERS = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "NEWS.md", "doc", "etc", "bench/README.md", "tests/README.md", "page", "share",
           "clients", "src")
# Tables that quote code and messages of earlier builds, and generated files.
NOT_TEXTS = ("doc/measured/inputs.md", "doc/measured/messages.md", "doc/measured/mutation", "doc/measured/reproduction/",
             "doc/page-", "page/package", "src/service/api/openapi_examples.json")
ENDINGS = (".c", ".h", ".cc", ".py", ".js", ".sh", ".md", ".html", ".css", ".json", ".yaml", ".conf", ".1", ".5", ".8")

PERSON = (r"\b(?:users?|clients?|callers?|administrators?|readers?|receivers?|browsers?|people|persons?|those|engineers?|anyone|owners?"
          r"|strangers?|operators?|you)\b[^.;:!?\x01]{0,40}$")

# pattern, what to write instead, a sentence with the phrase, a similar sentence without it, what may precede the phrase.
# A blank matches any white space, also between the lines of a comment and the parts of a string. Code in backticks is not searched.
PHRASES = [
    # persons for things
    (r"\bwho\b", "that, which, it", "particles who find no way", "the user who submitted the job", PERSON),
    (r"\b(?:nobody|somebody|whoever|everybody|anybody)\b", "the thread, process, user or particle, by its noun",
     "It wakes nobody.", "It wakes no thread."),
    (r"\b(?:tells?|told)\b", "returns, reports, states, shows, distinguishes", "The header tells the type.",
     "The header states the type.", PERSON),
    (r"\basks\b|\basked\b", "requests, requires, calls, evaluates", "a cell is asked for its area", "what the client asked for", PERSON),
    (r"\bwants\b|\bwanted\b", "requires, requested", "as far as a particle wants", "what the user wants", PERSON),
    (r"\bsaid\b|\b(?:cell|corner|point|particle|voxel|normal|triangle|block|line|row|value|neighbour|flag|bit|mask|number|length|size"
     r"|side|end|grid|node|part|patch|mean|sum|distance|gradient)s? (?:alone |only )?says?\b", "states, has, contains, means; by",
     "what the corners say of the area", "The report says why."),
    (r"\b(?:knows|knew)\b|\b(?:that|which|library|file|it|cells?|points?|particles?|does not|cannot) know\b",
     "stores, contains, supports, has", "A particle knows its neighbours.", "what you know of the file", PERSON),
    # quantities without a name
    (r"\bso (?:many|much|few|little)\b(?! (?:that|as))", "the symbol or the quantity, with its unit",
     "A cell is split so many times.", "The cell is split `depth` times."),
    (r"\bso far (?:apart|away|from|off|that|in\b|it\b|its\b)|\b(?:is|are|be|lies?|lay|of|moves?) so far\b(?! as)",
     "at this distance, with its unit", "points that are so far from each other", "the bytes received so far"),
    (r"\bthat (?:many|much)\b", "the quantity", "It needs that many points.", "It takes `count` points."),
    (r"\b(?:at most|at least|more than|less than|fewer than) that\b(?! (?:of|which|long|number))", "the quantity", "Cells have at most that.",
     "Cells have at most `limit` corners."),
    (r"\ba hair\b", "the tolerance", "larger by a hair", "larger by rounding"),
    # inversions
    (r"(?:(?<=[.:;] )|(?<=\x01)|(?<=\x01 ))(?-i:Of|Who|Besides)\b(?! \d)", "begin with the subject", "It is 0. Of a scan: the mean.",
     "It is 0. The mean of a scan."),
    (r"(?<!there )\b(?:is|are|was|were) no (?!longer|more|less|later|farther|larger|smaller|nearer|matter|sockets|other|such|warning)[a-z]",
     "is not a", "a value that is no number", "There is no such file; it is no longer here."),
    # private terms
    (r"\b(?:particles?|points?|who) (?:is|are) creased\b|\bcreased (?:particles?|points?)\b", "with divergent normals",
     "creased particles are skipped", "creased surfaces have edges"),
    (r"\brough levels?\b|\blevels? (?:is|are) rough\b", "level with a high defect fraction", "A rough level takes more sweeps.",
     "a rough estimate of the level"),
    (r"\b(?:points?|particles?) (?:is |are |which are |that are )?(?:out of order|in disorder|not in order)\b", "defect",
     "The points are in disorder.", "the points are sorted in order of x"),
    (r"\b(?:at|comes? to|came to|coming to) rest\b(?! /)|\brests\b", "converged, converges", "until particles come to rest",
     "the rest of the particles"),
    (r"\bstir(?:s|red)?\b|\bcalm(?:s|ed)?\b|\bput elsewhere\b", "mark displaced, clear displaced, relocated",
     "points that were put elsewhere", "relocated points"),
    (r"\b(?:sits?|sat) out\b|\b(?:particles?|points?) (?:that )?(?:sleeps?|wakes?|idles?)\b", "skipped, reactivated",
     "particles that sleep", "a thread that sleeps"),
    (r"\bland(?:s|ed|ing)?\b", "project, projection", "where the particle lands", "Landlock limits files"),
    (r"\bstands?\b(?!-| for\b| out\b)", "is, lies, has; copy for each incident patch", "The mesh is sampled as it stands.",
     "`*` stands for all users."),
    (r"(?<!contact )(?<!contact-)(?<!data )\bsheets\b", "opposite surface, opposite wall", "where two sheets meet", "contact sheets"),
    (r"\bturned from\b|\bsee(?:s|n)? through\b", "opposite; ignore normals", "neighbours turned from it", "turned about an axis"),
    (r"\bmend(?:s|ed|ing)?\b", "repair", "defects are mended", "defects are repaired"),
    (r"\beven(?:s|ed|ing)? out\b", "equalise", "areas are evened out", "equalised areas, even outside"),
    (r"\bbare (?:places?|sides?|areas?|spots?|parts?)\b|\b(?:is|are|stays?) bare\b", "uncovered, a gap in coverage",
     "The place is bare.", "the bare file name"),
    (r"\bcrowd(?:s|ed)?\b", "over-dense, dense", "crowded particles", "over-dense particles"),
    (r"\bcramped\b", "limited by the validity of the neighbour list", "a cramped step", "a limited step"),
    (r"\bgraz(?:e|es|ed|ing)\b", "crossed without a sign change at the corners", "cells that are grazed", "hidden crossings"),
    (r"\bcontinuation of (?:the|a|narrow) band\b|\bband is continued\b", "extrapolation of the narrow band",
     "the continuation of the band", "the continuation line of a header"),
    (r"\bswarm\b|\ballotments?\b", "Witkin-Heckbert solver; quota of points for each patch", "the allotment of a patch",
     "the quota of a patch"),
    (r"\broofs?\b|\bsieve[sd]?\b|\bfoot\b", "sufficient condition for the closest triangle; filter; closest point",
     "the foot on the triangle", "the footprint"),
    (r"\bheap of neighbours\b|\bin a heap\b", "neighbour list overflow", "the points lie in a heap", "memory of the heap"),
    (r"\bnamed pairs?\b|\bcoarse answers?\b", "the SIMD term; sampling of an under-resolved surface", "a coarse answer",
     "an answer for a coarse level"),
    (r"\bverdicts?\b", "outcome, decision", "the verdict of the job", "the outcome of the job"),
    (r"(?<!power )\blaws?\b|\bhouse\b|\bin vain\b", "dependency rule; architecture; without effect", "the house's rules", "the rules of the tree"),
]

# Identifiers that a renaming has replaced.
OLD_NAMES = {
    "relax_stir": "mark_displaced", "relax_calm": "clear_displaced", "relax_look_through": "ignore_normals",
    "relax_is_rough": "has_divergent_normals", "relax_let_idle": "enable_skipping", "relax_line_up": "load_lanes",
    "sampler_go_on": "resume_round", "sampler_take_back": "discard_result", "sampler_tell_spacings": "get_spacings",
    "sampler_judge_coarse": "detect_under_resolved", "sampler_even_out": "equalise_cells", "sampler_cover_parts": "seed_components",
    "sampler_hold": "pin_nearest", "sampler_merges_rows": "merges_close_curves", "sampler_stands": "patch_points",
    "mend_bench": "repair_scratch", "mend_piece": "repair_region", "curve_rows": "curve_samples", "near_rows": "near_curves",
    "star_sieve": "triangle_filter", "star_around": "triangle_filter_input", "voronoi_star_clear": "voronoi_star_planar",
    "star_rows": "star_lists", "STAR_ROWS": "STAR_LIST_MAX", "gather_rows": "gather_lists",
    "VORONOI_OTHER_SIDE": "VORONOI_OPPOSITE_COSINE", "STAR_OTHER_SIDE": "STAR_OPPOSITE_COSINE",
    "STAR_WIDEST": "TRIANGLE_MAX_CIRCUMRADIUS", "STAR_DEEP": "TRIANGLE_MIN_DEPTH", "STAR_CLEAR": "STAR_MIN_EDGE",
    "STAR_FLAT_FACING": "STAR_MIN_COSINE", "STAR_FLAT_HEIGHT": "STAR_MAX_SLOPE", "is_other_side": "is_opposite",
    "find_clear": "find_planar", "triangulation_is_whole": "triangulation_is_manifold", "bare_sides": "uncovered_curve_edges",
    "drop_beyond": "drop_beyond_curves", "foot_triangle": "smooth_triangle", "foot_lanes": "smooth_triangle_lanes",
    "foot_find_lanes": "smooth_triangle_find_lanes", "foot_facing": "smooth_triangle_turn", "foot_room": "smooth_triangle_margin",
    "foot_weights": "smooth_triangle_weights", "foot_own_normal": "smooth_triangle_own_normal", "foot_off": "smooth_triangle_offset",
    "foot_distance": "smooth_triangle_distance", "FOOT_ROOM": "SMOOTH_TRIANGLE_MARGIN",
    "FOOT_LEAST_FACING": "SMOOTH_TRIANGLE_MIN_COSINE", "merges_near_rows": "merges_near_curves",
    "mesh_faces_land": "mesh_faces_project", "mesh_faces_hide": "mesh_faces_has_hidden",
    "nearest_triangle_later": "nearest_triangle_new_lazy", "nearest_triangle_find_among": "nearest_triangle_find_accepted",
    "nearest_triangle_any": "nearest_triangle_any_in_box", "nearest_of_several": "triangle_forest",
    "triangle_groups_come_near": "triangle_groups_is_within", "triangle_groups_approach": "triangle_groups_lower_distances",
    "MESH_PATCHES_FOUND": "MESH_PATCHES_AUTOMATIC", "FIDELITY_MOST_THIN": "FIDELITY_MAX_THIN", "look_at_mesh": "sample_mesh",
    "test_house": "test_source_tree",
}

# file, pattern of the phrase, reason; at most 30
EXCEPTIONS = [
    ("src/service/api/openapi_schemas.json", "asked", "a member of answers"),
    ("src/service/api/paths.c", "asked", "a member of answers"),
    ("doc/meshes.md", "foot", "a unit of 3MF files"),
    ("src/io/meshes/plain_3mf.c", "foot", "a unit of 3MF files"),
]

BREAK = "\x01"  # code between two texts
C_TEXT = re.compile(r"//(?:\\\n|[^\n])*|/\*.*?\*/|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'", re.S)
JS_TEXT = re.compile(C_TEXT.pattern + r"|`(?:\\.|[^`\\])*`", re.S)


def hide(code):
    return re.sub(r"\S", BREAK, code)


def unquoted(text):
    """The content of a comment or string, with white space for its delimiters and escapes; as long as the text."""
    if text.startswith("//"):
        return re.sub(r"^/+", lambda m: " " * len(m[0]), text)
    if text.startswith("/*"):
        return "  " + re.sub(r"(?m)^(\s*)\*", r"\1 ", text[2:-2]) + "  "
    if text.startswith("#"):
        return re.sub(r"^#+", lambda m: " " * len(m[0]), text)
    quote = re.match(r"\w*('''|\"\"\"|['\"`])", text)
    inner = text[quote.end():-len(quote[1])]
    if quote[1] == "`":
        inner = re.sub(r"\$\{(?:[^{}`]|\{[^{}`]*\})*\}", lambda m: hide(m[0]), inner)
    return " " * quote.end() + re.sub(r"\\[nt\"']", "  ", inner) + " " * len(quote[1])


def texts_of_c(text, pattern):
    parts, at = [], 0
    for found in pattern.finditer(text):
        is_include = text[:found.start()].rsplit("\n", 1)[-1].strip() == "#include"
        parts += [hide(text[at:found.start()]), hide(found[0]) if is_include else unquoted(found[0])]
        at = found.end()
    return "".join(parts) + hide(text[at:])


def texts_of_python(text):
    starts = [0]
    for line in text.splitlines(True):
        starts.append(starts[-1] + len(line))
    parts = list(hide(text))
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            begin, end = (starts[row - 1] + column for row, column in (token.start, token.end))
            parts[begin:end] = unquoted(text[begin:end])
    return "".join(parts)


def texts_of(name, text):
    """The comments and strings of a program, or all of a page; other characters than white space are BREAK."""
    if name.endswith((".c", ".h", ".cc")):
        return texts_of_c(text, C_TEXT)
    if name.endswith(".js"):
        return texts_of_c(text, JS_TEXT)
    return texts_of_python(text) if name.endswith(".py") else text


def on_one_line(text):
    """The text with each run of white space as one blank, or as BREAK if code lies in it; and the line of each character."""
    parts, lines, line = [], [], 1
    for word in re.findall(rf"[\s{BREAK}]+|[^\s{BREAK}]+", text):
        blank = word[0].isspace() or word[0] == BREAK
        part = (BREAK if BREAK in word else " ") if blank else word
        line += word.count("\n")
        parts.append(part)
        lines += [line] * len(part)
    return "".join(parts), lines


@functools.cache
def patterns():
    names = re.compile(r"(?<![\w/])(" + "|".join(OLD_NAMES) + r")(?!\w)")
    return [(re.compile(row[0], re.I), row[1], re.compile(row[4], re.I) if len(row) > 4 else None) for row in PHRASES], names


def matches(name, text):
    """(line, phrase, what to write instead) of each match in a file."""
    phrases, names = patterns()
    flat, lines = on_one_line(texts_of(name, text))
    found = [(lines[m.start()], m[0], OLD_NAMES[m[1]]) for m in names.finditer(flat)]
    prose = re.sub(r"`[^`\x01]{1,200}`", lambda m: BREAK * len(m[0]), flat.replace("```", BREAK * 3))
    for pattern, instead, before in phrases:
        found += [(lines[m.start()], m[0], instead) for m in pattern.finditer(prose)
                  if not (before and before.search(prose, max(0, m.start() - 60), m.start()))]
    return sorted(found)


def files(root, folders=FOLDERS):
    listed = subprocess.run(["git", "-C", root, "ls-files", "--", *folders], capture_output=True, text=True).stdout.splitlines()
    if not listed:
        listed = [str(path.relative_to(root)) for folder in folders
                  for path in ([root / folder] if (root / folder).is_file() else sorted((root / folder).rglob("*"))) if path.is_file()]
    return [name for name in listed if (name.endswith(ENDINGS) or name.startswith("share/")) and "node_modules" not in name
            and not name.startswith(NOT_TEXTS) and (root / name).is_file()]


def faults(root, folders=FOLDERS):
    found = []
    for name in files(root, folders):
        allowed = [pattern for file, pattern, _ in EXCEPTIONS if file == name]
        found += [(name, line, phrase, instead) for line, phrase, instead in matches(name, (root / name).read_text())
                  if not any(re.fullmatch(pattern, phrase, re.I) for pattern in allowed)]
    return found


def main():
    root = pathlib.Path(__file__).resolve().parents[1]
    counts = collections.Counter()
    for name, line, phrase, instead in faults(root, sys.argv[1:] or FOLDERS):
        print(f"{name}:{line}: \"{phrase}\": {instead}")
        counts["/".join(name.split("/")[:2]) if name.startswith("src/") else name.split("/")[0]] += 1
    for folder, count in sorted(counts.items()):
        print(f"{count:5d} {folder}")
    print(f"{sum(counts.values()):5d} in all")


if __name__ == "__main__":
    main()
