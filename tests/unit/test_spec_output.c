// SPDX-License-Identifier: Apache-2.0
/* spec: outputs, and cameras of the pictures. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "spec/spec.h"
#include "spec_text.h"

#define CAMERA(members) "\"preview\":{\"camera\":{" members "}}"
#define PLACED(members) CAMERA("\"position\":[0,-5,1],\"target\":[0,0,1]" members)

static spec *parse(const char *output, spec_faults *faults, error *e)
{
    char *members = mem_printf(",\"output\":{%s}", output);
    spec *s = spec_of_text(members, faults, e);
    free(members);
    return s;
}

static spec *accept(const char *output)
{
    error e = {0};
    spec *s = parse(output, NULL, &e);
    if (!s) fail_msg("%s: %s", output, e.message);
    return s;
}

static void refuse(const char *output, const char *pointer, const char *words)
{
    error e = {0};
    spec_faults faults;
    if (parse(output, &faults, &e)) fail_msg("accepted: %s", output);
    assert_int_equal(e.code, ERROR_SPEC_INVALID);
    assert_string_equal(faults.item[0].pointer, pointer);
    if (!strstr(faults.item[0].detail, words))
        fail_msg("'%s' does not say '%s'", faults.item[0].detail, words);
}

static void cameras_are_read(void **state)
{
    (void)state;
    spec *s = accept(PLACED(""));
    assert_true(s->has_camera && s->camera.fov == 0 && s->camera.orthographic == 0);
    assert_true(s->camera.position.y == -5 && s->camera.target.z == 1 && s->camera.up.z == 1);
    spec_free(s);
    s = accept(PLACED(",\"up\":[1,0,0],\"orthographic\":2.5"));
    assert_true(s->camera.orthographic == 2.5 && s->camera.up.x == 1);
    spec_free(s);
    s = accept(PLACED(",\"fov\":0.8"));
    assert_true(s->camera.fov == 0.8);
    spec_free(s);
    s = accept("");
    assert_false(s->has_camera);
    spec_free(s);
}

static void cameras_without_a_view_are_refused(void **state)
{
    (void)state;
    static const char at[] = "/output/preview/camera";
    refuse(CAMERA("\"position\":[1,2,3]"), "/output/preview/camera/target", "is required");
    refuse(CAMERA("\"position\":[1,2,3],\"target\":[1,2,3]"), "/output/preview/camera/target",
           "is equal to position");
    refuse(PLACED(",\"up\":[0,-3,0]"), "/output/preview/camera/up", "parallel to the line of sight");
    refuse(PLACED(",\"up\":[0,0,0]"), "/output/preview/camera/up", "up is zero");
    /* of the default up vector */
    refuse(CAMERA("\"position\":[0,0,5],\"target\":[0,0,1]"), at, "up is zero");
    refuse(PLACED(",\"fov\":1,\"orthographic\":1"), at, "at most one of fov, orthographic");
}

static void outputs_are_parsed(void **state)
{
    (void)state;
    spec *s = accept("");
    assert_false(s->has_mesh || s->points_in[FILE_FORMAT_VDB] || s->has_convergence);
    assert_int_equal(s->turntable, 0);
    spec_free(s);
    s = accept("\"mesh\":true,\"points_vdb\":true,\"convergence\":true,\"preview\":{\"turntable\":24,"
               "\"color\":\"degree\"}");
    assert_true(s->has_mesh && s->points_in[FILE_FORMAT_VDB] && s->has_convergence);
    assert_int_equal(s->turntable, 24);
    assert_int_equal(s->preview_color, SPEC_COLOR_DEGREE);
    spec_free(s);
    refuse("\"mesh\":1", "/output/mesh", "must be true or false (given 1)");
}

static void the_order_of_the_points_is_a_word(void **state)
{
    (void)state;
    spec *s = accept("");
    assert_false(s->has_order);
    spec_free(s);
    s = accept("\"order\":\"progressive\"");
    assert_true(s->has_order && s->order == SPEC_ORDER_PROGRESSIVE);
    spec_free(s);
    s = accept("\"order\":\"spatial\"");
    assert_true(s->has_order && s->order == SPEC_ORDER_SPATIAL);
    spec_free(s);
    refuse("\"order\":\"random\"", "/output/order",
           "must be one of \"progressive\", \"spatial\", \"id\" (given \"random\")");
    refuse("\"order\":true", "/output/order", "must be one of");
    refuse("\"order\":\"id\"", "/output/order", "\"id\" requires queue.coherent");
}

static void a_range_needs_values(void **state)
{
    (void)state;
    static const char *const shaded[] = {"", ",\"color\":\"shading\"", ",\"map\":\"gray\""};
    for (size_t k = 0; k < sizeof shaded / sizeof *shaded; k++) {
        char *output = mem_printf("\"preview\":{\"range\":[0,1]%s}", shaded[k]);
        refuse(output, "/output/preview/range", "the preview is shaded: set color or attribute");
        free(output);
    }
    spec_free(accept("\"preview\":{\"range\":[0,1],\"color\":\"curvature\"}"));
    spec_free(accept("\"preview\":{\"range\":[0,1],\"color\":\"shading\",\"attribute\":\"heat\"}"));
    /* a graded spacing is shown by default */
    static const char graded[] =
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},\"sampling\":{\"count\":100,"
        "\"curvature\":{\"ratio\":2}},\"output\":{\"preview\":{\"range\":[0,1]}}}";
    json *document = json_parse(graded, strlen(graded), NULL);
    spec *s = spec_parse(document, NULL, NULL);
    assert_non_null(s);
    spec_free(s);
    json_free(document);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cameras_are_read),     cmocka_unit_test(cameras_without_a_view_are_refused),
        cmocka_unit_test(outputs_are_parsed),   cmocka_unit_test(the_order_of_the_points_is_a_word),
        cmocka_unit_test(a_range_needs_values),
    };
    return cmocka_run_group_tests_name("spec_output", tests, NULL, NULL);
}
