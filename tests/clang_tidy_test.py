# SPDX-License-Identifier: Apache-2.0
"""Which changes of a source make scripts/clang-tidy --since check it again."""
from clang_tidy import checked_text

SOURCE = """#include <string>
// Length of the rod.
int length() { return 3; }  // mm
const char* kUrl = "http://a";
"""


def test_other_words_in_a_comment_are_no_change():
    other = SOURCE.replace("// Length of the rod.\n", "// The length of the rod\n// and nothing else.\n").replace("// mm", "// millimetres")
    assert checked_text(other) == checked_text(SOURCE)


def test_code_strings_and_comments_that_clang_tidy_reads_are_changes():
    for before, after in (("return 3", "return 4"), ("//a", "//b"), ("// mm", "// NOLINT"), ("{ return", "{ /*unit=*/ return")):
        assert checked_text(SOURCE.replace(before, after)) != checked_text(SOURCE), after
