// SPDX-License-Identifier: Apache-2.0
/* inspection_text: prints an inspection as text. */
#include <stdlib.h>
#include <string.h>

#include "base/core/terminal_text.h"
#include "job/inspect/inspection.h"

static double number_of(json_at object, const char *key)
{
    return json_number(json_member(&object, key), 0);
}

static const char *text_of(json_at object, const char *key)
{
    return json_string(json_member(&object, key), "?");
}

static void print_numbers(FILE *out, json_at list, const char *between)
{
    for (json_at item = json_first(&list); item.node; item = json_next(&item))
        terminal_text_print(out, "%s%.6g", item.index ? between : "", json_number(item, 0));
}

static void print_box(FILE *out, json_at object)
{
    json_at box = json_member(&object, "bounding_box"), low = json_member(&box, "min"),
            high = json_member(&box, "max");
    if (!box.node) return;
    fputs("  box        (", out);
    print_numbers(out, low, ", ");
    fputs(") to (", out);
    print_numbers(out, high, ", ");
    fputs(")\n", out);
}

/* Prints a bar with one character for each bin: its fraction on a logarithmic scale. */
static void print_histogram(FILE *out, json_at object)
{
    static const char bars[] = " .:-=+*#@";
    static const double from[] = {0, 1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3};
    json_at bins = json_member(&object, "histogram");
    if (json_size(bins) == 0) return;
    fputs("  histogram  |", out);
    for (json_at bin = json_first(&bins); bin.node; bin = json_next(&bin)) {
        double share = json_number(bin, 0);
        int level = 0;
        while (level < 8 && share > 0 && share >= from[level + 1]) level++;
        putc(share > 0 && level == 0 ? bars[1] : bars[level], out);
    }
    fputs("|\n", out);
}

static void print_values(FILE *out, json_at object)
{
    json_at range = json_member(&object, "range"), voxel = json_member(&object, "voxel_size"),
            fault = json_member(&object, "error");
    if (fault.node) {
        fputs("  error      ", out);
        terminal_text_put(out, json_type_of(fault) == JSON_OBJECT ? text_of(fault, "message")
                                                                  : json_string(fault, "?"));
        putc('\n', out);
    }
    if (voxel.node) {
        fputs("  voxel      ", out);
        print_numbers(out, voxel, " x ");
        putc('\n', out);
    }
    print_box(out, object);
    if (!range.node || number_of(object, "values") == 0) return;
    fputs("  values     ", out);
    print_numbers(out, range, " to ");
    terminal_text_print(out, "%s",
                        json_bool(json_member(&object, "integral"), false) ? ", whole numbers" : "");
    if (number_of(object, "not_finite") > 0)
        fprintf(out, ", %.0f not finite", number_of(object, "not_finite"));
    putc('\n', out);
    print_histogram(out, object);
}

static void print_grids(FILE *out, json_at grids)
{
    for (json_at g = json_first(&grids); g.node; g = json_next(&g)) {
        json_at voxels = json_member(&g, "active_voxels");
        fputs("grid \"", out);
        terminal_text_put(out, text_of(g, "name"));
        terminal_text_print(out, "\": %s, %s", text_of(g, "type"), text_of(g, "class"));
        if (voxels.node)
            fprintf(out, ", %.0f active voxels, background %.6g", json_number(voxels, 0),
                    number_of(g, "background"));
        else if (!json_bool(json_member(&g, "scalar"), false))
            fputs("; a surface is taken from float or double", out);
        putc('\n', out);
        print_values(out, g);
    }
}

static void print_images(FILE *out, json_at root)
{
    json_at channels = json_member(&root, "channels"), stacks = json_member(&root, "stacks");
    for (json_at c = json_first(&channels); c.node; c = json_next(&c)) {
        json_at window = json_member(&c, "data_window");
        fputs("channel \"", out);
        terminal_text_put(out, text_of(c, "channel"));
        if (*text_of(c, "part")) {
            fputs("\" of part \"", out);
            terminal_text_put(out, text_of(c, "part"));
        }
        terminal_text_print(out, "\": %s, %s, pixels ", text_of(c, "type"), text_of(c, "storage"));
        print_numbers(out, window, " ");
        putc('\n', out);
    }
    double images = number_of(root, "images");
    if (channels.node && images == 1)
        fputs("one image: a volume is a stack of them, with numbers in their names\n", out);
    else if (channels.node)
        fprintf(out, "one of %.0f images with numbers in their names\n", images);
    for (json_at s = json_first(&stacks); s.node; s = json_next(&s)) {
        fputs("stack of channel \"", out);
        terminal_text_put(out, text_of(s, "channel"));
        fputs("\"\n", out);
        print_values(out, s);
    }
}

static void print_labels(FILE *out, json_at labels)
{
    for (json_at l = json_first(&labels); l.node; l = json_next(&l)) {
        fprintf(out, "label %.0f: %.0f voxels, ", number_of(l, "label"), number_of(l, "voxels"));
        print_numbers(out, json_member(&l, "low"), " ");
        fputs(" to ", out);
        print_numbers(out, json_member(&l, "high"), " ");
        fputs(", touches", out);
        const json_at neighbours = json_member(&l, "neighbours");
        for (json_at neighbour = json_first(&neighbours); neighbour.node; neighbour = json_next(&neighbour))
            fprintf(out, " %.0f", json_number(neighbour, 0));
        putc('\n', out);
    }
}

static void print_volume(FILE *out, json_at volume)
{
    if (!volume.node) return;
    terminal_text_print(out, "volume: %s, ", text_of(volume, "type"));
    print_numbers(out, json_member(&volume, "size"), " x ");
    if (json_type_of(json_member(&volume, "space")) == JSON_STRING)
        terminal_text_print(out, ", %s", text_of(volume, "space"));
    putc('\n', out);
    const json_at warnings = json_member(&volume, "warnings");
    for (json_at warning = json_first(&warnings); warning.node; warning = json_next(&warning))
        terminal_text_print(out, "  warning    %s\n", json_string(warning, "?"));
    print_values(out, volume);
    print_labels(out, json_member(&volume, "labels"));
}

static void print_levels(FILE *out, json_at levels)
{
    for (json_at l = json_first(&levels); l.node; l = json_next(&l)) {
        terminal_text_print(out, "level %zu: %s, ", l.index, text_of(l, "type"));
        print_numbers(out, json_member(&l, "size"), " x ");
        fputs(", voxel ", out);
        print_numbers(out, json_member(&l, "voxel_size"), " x ");
        fputs(", chunks of ", out);
        print_numbers(out, json_member(&l, "chunk"), " x ");
        putc('\n', out);
    }
}

static void print_vertex_values(FILE *out, json_at values)
{
    for (json_at v = json_first(&values); v.node; v = json_next(&v)) {
        fputs("  values     \"", out);
        terminal_text_put(out, text_of(v, "name"));
        fputs("\" ", out);
        print_numbers(out, json_member(&v, "minimum"), " ");
        fputs(" to ", out);
        print_numbers(out, json_member(&v, "maximum"), " ");
        putc('\n', out);
    }
}

static void print_mesh(FILE *out, json_at mesh)
{
    if (!mesh.node) return;
    double open = number_of(mesh, "open_edges");
    json_at notes = json_member(&mesh, "notes");
    terminal_text_print(out, "mesh: %.0f vertices, %.0f triangles, %.0f component%s, area %.6g, ",
                        number_of(mesh, "vertices"), number_of(mesh, "triangles"),
                        number_of(mesh, "components"), number_of(mesh, "components") == 1 ? "" : "s",
                        number_of(mesh, "area"));
    if (open > 0)
        fprintf(out, "open at %.0f edges\n", open);
    else
        fputs("closed\n", out);
    print_box(out, mesh);
    if (open > 0) {
        fputs("open edges:\n", out);
        print_box(out, json_member(&mesh, "open_at"));
    }
    print_vertex_values(out, json_member(&mesh, "values"));
    for (json_at note = json_first(&notes); note.node; note = json_next(&note))
        terminal_text_print(out, "  note       %s\n", json_string(note, "?"));
}

/* Prints a value that can be pasted into a spec, and a line break. */
static void print_json(FILE *out, const json *value)
{
    char *text = json_print(value);
    terminal_text_write(out, TERMINAL_TEXT_JSON, text, strlen(text));
    fputc('\n', out);
    free(text);
}

static void print_suggestion(FILE *out, json_at s)
{
    json_at spec = json_member(&s, "spec"), fault = json_member(&s, "error"),
            count = json_member(&s, "count"), shape = json_member(fault.node ? &s : &spec, "surface"),
            warnings = json_member(&s, "warnings");
    if (fault.node) {
        fputs("cannot be sampled: ", out);
        terminal_text_put(out, text_of(fault, "message"));
        fputs("\n  surface    ", out);
        print_json(out, shape.node);
    } else {
        bool measured = json_bool(json_member(&s, "measured"), false);
        if (json_type_of(json_member(&s, "area")) == JSON_NUMBER)
            terminal_text_print(out, "area %s%.6g, ", measured ? "" : "about ", number_of(s, "area"));
        if (!measured)
            fputs("not measured: the scan of its cells exceeds the time of an inspection\n", out);
        else if (json_type_of(count) == JSON_NUMBER)
            fprintf(out, "resolved by %.0f points (spacing %.3g)\n", json_number(count, 0),
                    number_of(s, "spacing"));
        else
            fprintf(out, "resolved by a spacing of %.3g, which exceeds the maximum number of points\n",
                    number_of(s, "spacing"));
        fputs("  spec       ", out);
        print_json(out, spec.node);
    }
    for (json_at warning = json_first(&warnings); warning.node; warning = json_next(&warning))
        terminal_text_print(out, "  warning    %s\n", json_string(warning, "?"));
}

void inspection_print(const json *inspection, FILE *out)
{
    json_at root = json_root(inspection), suggestions = json_member(&root, "suggestions");
    terminal_text_put(out, text_of(root, "path"));
    terminal_text_print(out, ": %s, %.0f bytes\n", text_of(root, "format"), number_of(root, "bytes"));
    print_grids(out, json_member(&root, "grids"));
    print_levels(out, json_member(&root, "levels"));
    print_volume(out, json_member(&root, "volume"));
    print_images(out, root);
    print_mesh(out, json_member(&root, "mesh"));
    if (json_size(suggestions) > 0) fputs("surfaces to try:\n", out);
    for (json_at suggestion = json_first(&suggestions); suggestion.node;
         suggestion = json_next(&suggestion)) {
        fprintf(out, "%zu. ", suggestion.index + 1);
        print_suggestion(out, suggestion);
    }
}
