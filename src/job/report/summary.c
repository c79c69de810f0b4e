// SPDX-License-Identifier: Apache-2.0
#include "job/report/summary.h"

#include "base/core/terminal_text.h"

static double number_of(json_at object, const char *key)
{
    return json_number(json_member(&object, key), 0);
}

/* Prints the first rating, "hex_fraction 0.9130 (good)"; "not measured" for null. */
static void print_rating(json_at root, FILE *out)
{
    json_at ratings = json_member(&root, "ratings"), rated = json_first(&ratings),
            rating = json_member(&rated, "rating");
    terminal_text_put(out, rated.key);
    if (json_type_of(rating) == JSON_STRING)
        terminal_text_print(out, " %.4f (%s)", number_of(rated, "value"), json_string(rating, "?"));
    else
        fputs(" not measured", out);
}

static void print_reasons(json_at report, FILE *err)
{
    json_at reasons = json_member(&report, "outcome_reasons");
    for (json_at r = json_first(&reasons); r.node; r = json_next(&r)) {
        terminal_text_print(err, "%s: %s\n", json_string(json_member(&report, "outcome"), "?"),
                            json_string(json_member(&r, "message"), "?"));
    }
}

/* Prints "1000 points attached, 0.12 s". */
static void print_attached(json_at root, FILE *out)
{
    json_at attached = json_member(&root, "attached"), timing = json_member(&root, "timing_s");
    const double without = number_of(attached, "without_place");
    fprintf(out, "%.0f points attached", number_of(root, "count") - without);
    if (without > 0) fprintf(out, ", %.0f without a place", without);
    fprintf(out, ", %.2f s\n", number_of(timing, "total"));
}

static void print_sampled(json_at root, FILE *out)
{
    json_at quality = json_member(&root, "quality"), timing = json_member(&root, "timing_s");
    terminal_text_print(out, "%.0f points, spacing %.3g, %s, ", number_of(root, "count"),
                        number_of(root, "spacing"), json_string(json_member(&root, "outcome"), "?"));
    print_rating(root, out);
    json_at reached = json_member(&root, "reached"), ratio = json_member(&reached, "ratio");
    if (ratio.node) fprintf(out, ", spacing %.3g:1", json_number(ratio, 0));
    fprintf(out, ", coverage %.2f h, max_residual %.1e h, %.2f s\n", number_of(quality, "coverage"),
            number_of(quality, "max_residual"), number_of(timing, "total"));
}

void summary_print(const json *report, FILE *out, FILE *err)
{
    json_at root = json_root(report), surface = json_member(&root, "surface"),
            warnings = json_member(&surface, "warnings"), advice = json_member(&root, "advice");
    if (json_member(&root, "attached").node)
        print_attached(root, out);
    else
        print_sampled(root, out);
    print_reasons(root, err);
    for (json_at warning = json_first(&warnings); warning.node; warning = json_next(&warning))
        terminal_text_print(err, "warning: %s\n", json_string(warning, "?"));
    for (json_at item = json_first(&advice); item.node; item = json_next(&item)) {
        terminal_text_print(err, "advice: %s\n", json_string(json_member(&item, "message"), "?"));
    }
}
