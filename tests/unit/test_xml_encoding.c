// SPDX-License-Identifier: Apache-2.0
/* Documents of XML in other encodings: which are converted, and to which bytes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/xml/xml.h"

/* Compares the copy of a document with `expected`; NULL: there is none. */
static void check(const char *data, size_t size, const char *expected)
{
    size_t now = size;
    char *copy = malloc(size + 1); /* exact, so that a sanitizer sees a read behind the end */
    memcpy(copy, data, size);
    copy[size] = 0;
    char *made = xml_in_utf8(copy, &now);
    free(copy);
    if (!expected) {
        assert_null(made);
        assert_int_equal(now, size);
        return;
    }
    assert_non_null(made);
    assert_int_equal(now, strlen(expected));
    assert_memory_equal(made, expected, now + 1);
    free(made);
}

#define CHECK(data, expected) check(data, sizeof(data) - 1, expected)

static void utf_8_is_not_copied(void **state)
{
    (void)state;
    CHECK("", NULL);
    CHECK("<", NULL);
    CHECK("<a/>", NULL);
    CHECK("\xEF\xBB\xBF<a/>", NULL);
    CHECK("<?xml version='1.0'?><a/>", NULL);
    CHECK("<?xml version='1.0' encoding='UTF-8'?><a b='\xC3\xA4'/>", NULL);
    CHECK("<?xml version='1.0' encoding='ISO-8859-15'?><a/>", NULL);
    CHECK("<?xml version='1.0'?><a encoding='ISO-8859-1'/>", NULL);
    CHECK("<?xml encoding", NULL);
    CHECK("<?xml encoding=>", NULL);
}

static void bytes_of_latin_1_become_characters(void **state)
{
    (void)state;
    CHECK("<?xml encoding=\"ISO-8859-1\"?><a b=\"\xE4\x80\x7F\"/>",
          "<?xml encoding=\"ISO-8859-1\"?><a b=\"\xC3\xA4\xC2\x80\x7F\"/>");
    CHECK("<?xml encoding = 'Latin1' ?>\xFF", "<?xml encoding = 'Latin1' ?>\xC3\xBF");
}

static void bytes_of_windows_1252_become_characters(void **state)
{
    (void)state;
    CHECK("<?xml encoding='windows-1252'?>\x80\x9F\x81\xE4",
          "<?xml encoding='windows-1252'?>\xE2\x82\xAC\xC5\xB8\xC2\x81\xC3\xA4");
    CHECK("<?xml encoding='CP1252'?>\x96", "<?xml encoding='CP1252'?>\xE2\x80\x93");
}

/* The byte order mark stays, as the first character. */
static void units_of_utf_16_become_characters(void **state)
{
    (void)state;
    CHECK("\xFF\xFE<\0a\0/\0>\0", "\xEF\xBB\xBF<a/>");
    CHECK("\xFE\xFF\0<\0a\0/\0>", "\xEF\xBB\xBF<a/>");
    CHECK("<\0\xE4\0\xAC\x20\x3D\xD8\x00\xDE", "<\xC3\xA4\xE2\x82\xAC\xF0\x9F\x98\x80");
    CHECK("\0<\xD8\x3D\xDE\x00", "<\xF0\x9F\x98\x80");
}

static void halves_of_surrogates_are_replaced(void **state)
{
    (void)state;
    CHECK("\0<\xD8\x3D", "<\xEF\xBF\xBD");
    CHECK("\0<\xD8\x3D\0a", "<\xEF\xBF\xBD"
                            "a");
    CHECK("\0<\xDE\x00\0a", "<\xEF\xBF\xBD"
                            "a");
    CHECK("\0<\xD8\x3D\xD8\x3D\xDE\x00", "<\xEF\xBF\xBD\xF0\x9F\x98\x80");
    CHECK("\0<\0a\0", "<a"); /* an odd byte at the end */
}

/* Binary data of VTK keep their bytes, the byte 0 included. */
static void appended_data_are_copied(void **state)
{
    (void)state;
    static const char data[] = "<?xml encoding='ISO-8859-1'?>\xE4<AppendedData encoding='raw'>_\xE4\0\x80",
                      expected[] =
                          "<?xml encoding='ISO-8859-1'?>\xC3\xA4<AppendedData encoding='raw'>_\xE4\0\x80";
    size_t size = sizeof data - 1;
    char *made = xml_in_utf8(data, &size);
    assert_non_null(made);
    assert_int_equal(size, sizeof expected - 1);
    assert_memory_equal(made, expected, sizeof expected);
    free(made);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(utf_8_is_not_copied),
        cmocka_unit_test(bytes_of_latin_1_become_characters),
        cmocka_unit_test(bytes_of_windows_1252_become_characters),
        cmocka_unit_test(units_of_utf_16_become_characters),
        cmocka_unit_test(halves_of_surrogates_are_replaced),
        cmocka_unit_test(appended_data_are_copied),
    };
    return cmocka_run_group_tests_name("xml_encoding", tests, NULL, NULL);
}
