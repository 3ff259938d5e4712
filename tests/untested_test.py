# SPDX-License-Identifier: Apache-2.0
"""Every product file has a test or a stated reason why it has none (scripts/lib/untested.py)."""
import pytest
from programs import SOURCE
from untested import problems


def test_product():
    found = problems(SOURCE)
    assert not found, "\n" + "\n".join(found)


TESTED = {
    "formats/a.h": "", "formats/a.cpp": "", "tests/formats/a_test.cpp": "",
    "pipeline/x/b.cpp": "", "tests/pipeline/x/b_test.py": "",
    "runtime/c.h": "// SPDX\n// Tests: tests/one_test.cpp, tests/two_test.py\n", "runtime/c.cpp": "", "tests/one_test.cpp": "", "tests/two_test.py": "",
    "runtime/page/d.js": "", "runtime/page/vendor/e.js": "",
    "tests/untested.txt": "# PATH reason\nruntime/page/d.js It only draws.\n",
}


@pytest.mark.parametrize("changed, complaint", [
    ({}, None),
    ({"runtime/x/a.h": ""}, "runtime/x/a.h has no test: add tests/runtime/x/a_test.cpp"),
    ({"runtime/c.cpp": "// Tests: tests/three_test.py"}, "runtime/c.cpp: its test tests/three_test.py does not exist"),
    ({"tests/untested.txt": "runtime/page/d.js"}, "tests/untested.txt: runtime/page/d.js has no reason"),
    ({"tests/runtime/page/d_test.py": ""}, "tests/untested.txt: runtime/page/d.js has a test"),
    ({"runtime/page/d.js": "// Tests: tests/one_test.cpp"}, "tests/untested.txt: runtime/page/d.js has a test"),
    ({"tests/untested.txt": TESTED["tests/untested.txt"] + "runtime/gone.h It is gone."}, "tests/untested.txt: runtime/gone.h does not exist"),
    ({"tests/untested.txt": ""}, "runtime/page/d.js has no test"),
])
def test_problem_is_found(tmp_path, changed, complaint):
    for name, text in {**TESTED, **changed}.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    found = problems(tmp_path)
    assert len(found) == (complaint is not None) and all(line.startswith(complaint) for line in found), found
