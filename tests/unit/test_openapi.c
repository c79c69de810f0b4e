// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "service/api/openapi.h"

static http_handler *const handlers[] = {openapi_show, openapi_show_schema};

/* The tag of an answer. */
static const char *tag_of(const reply *r)
{
    for (size_t i = 0; i < r->header_count; i++)
        if (strcmp(r->header[i].name, "ETag") == 0) return r->header[i].value;
    fail_msg("an answer has no ETag");
    return NULL;
}

static void answers_share_the_bytes_of_a_document(void **state)
{
    (void)state;
    openapi *o = openapi_new();
    http_context c = {.openapi = o};
    http_request request = {0};
    for (size_t i = 0; i < 2; i++) {
        reply first = {.fd = -1}, second = {.fd = -1};
        handlers[i](&c, &request, &first);
        handlers[i](&c, &request, &second);
        assert_true(first.status == 200 && first.constant && !first.body);
        assert_ptr_equal(first.constant, second.constant);
        assert_int_equal(first.length, strlen(first.constant));
        assert_string_equal(tag_of(&first), tag_of(&second));
        reply_clear(&first);
        reply_clear(&second);
    }
    openapi_free(o);
}

static void a_known_document_is_not_sent_again(void **state)
{
    (void)state;
    openapi *o = openapi_new();
    http_context c = {.openapi = o};
    for (size_t i = 0; i < 2; i++) {
        reply all = {.fd = -1}, known = {.fd = -1};
        http_request request = {0};
        handlers[i](&c, &request, &all);
        request.header[HTTP_IF_NONE_MATCH] = tag_of(&all);
        handlers[i](&c, &request, &known);
        assert_true(known.status == 304 && !known.constant);
        assert_string_equal(tag_of(&known), tag_of(&all));
        reply_clear(&all);
        reply_clear(&known);
    }
    openapi_free(o);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(answers_share_the_bytes_of_a_document),
        cmocka_unit_test(a_known_document_is_not_sent_again),
    };
    return cmocka_run_group_tests_name("openapi", tests, NULL, NULL);
}
