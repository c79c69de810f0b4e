#include "run/summary.h"

static double number_of(json_at object, const char *key)
{
    return json_number(json_member(&object, key), 0);
}

/* "hex_fraction 0.913 of the 5.2 % resolved, 0.548 of all"; a measure that is null is "not measured". */
static void print_hexagons(json_at quality, FILE *out)
{
    json_at all = json_member(&quality, "all"), of_all = json_member(&all, "hex_fraction"),
            resolved = json_member(&quality, "hex_fraction"), share = json_member(&quality, "resolved_share");
    if (json_type_of(share) != JSON_NUMBER) {
        fputs("hex_fraction not measured: all points lie near a boundary", out);
    } else if (number_of(quality, "unresolved_count") == 0) {
        fprintf(out, "hex_fraction %.4f, all points resolved", json_number(resolved, 0));
    } else {
        if (json_type_of(resolved) == JSON_NUMBER)
            fprintf(out, "hex_fraction %.4f", json_number(resolved, 0));
        else
            fputs("hex_fraction not measured", out);
        fprintf(out, " of the %.3g %% resolved, %.4f of all", 100 * json_number(share, 0),
                json_number(of_all, 0));
    }
}

static void print_reasons(json_at report, FILE *err)
{
    json_at reasons = json_member(&report, "outcome_reasons");
    for (size_t k = 0; k < json_size(reasons); k++) {
        json_at r = json_element(&reasons, k);
        fprintf(err, "%s: %s %.3g, bound %.3g: %s\n", json_string(json_member(&report, "outcome"), "?"),
                json_string(json_member(&r, "criterion"), "?"), number_of(r, "value"), number_of(r, "bound"),
                json_string(json_member(&r, "message"), "?"));
    }
}

void summary_print(const json *report, FILE *out, FILE *err)
{
    json_at root = json_root(report), quality = json_member(&root, "quality"),
            surface = json_member(&root, "surface"), warnings = json_member(&surface, "warnings"),
            advice = json_member(&root, "advice"), timing = json_member(&root, "timing_s");
    fprintf(out, "%.0f points, %s, ", number_of(root, "count"),
            json_string(json_member(&root, "outcome"), "?"));
    print_hexagons(quality, out);
    json_at reached = json_member(&root, "reached"), ratio = json_member(&reached, "ratio");
    if (ratio.node) fprintf(out, ", spacing %.3g:1", json_number(ratio, 0));
    fprintf(out, ", max_residual %.1e h, %.2f s\n", number_of(quality, "max_residual"),
            number_of(timing, "total"));
    print_reasons(root, err);
    for (size_t k = 0; k < json_size(warnings); k++)
        fprintf(err, "warning: %s\n", json_string(json_element(&warnings, k), "?"));
    for (size_t k = 0; k < json_size(advice); k++) {
        json_at item = json_element(&advice, k);
        fprintf(err, "advice: %s\n", json_string(json_member(&item, "message"), "?"));
    }
}
