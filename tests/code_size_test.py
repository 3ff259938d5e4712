# SPDX-License-Identifier: Apache-2.0
"""How large the product's files, functions and folders may be.

 1. A file (.h, .cpp, .js, .html, .css) has at most 500 lines, unless a line of its leading comment begins "Long because".
 2. A C++ function has at most 100 lines, signature included, unless the comment directly above it has such a line.
 3. A folder has at most 20 ideas; files whose names agree up to the first dot are one idea.

For each rule, a test shows that it fails on made-up code.
"""
import re

import pytest
from folders import PRODUCT
from programs import SOURCE

MAX_FILE_LINES, MAX_FUNCTION_LINES, MAX_IDEAS = 500, 100, 20
REASON = "Long because "
SUFFIXES = {".h", ".cpp", ".js", ".html", ".css"}
FETCHED = {"vendor", "node_modules"}  # other people's files in a folder of ours
COMMENT = re.compile(r"\s*(//|/?\*|<!--)")


def has_reason(comment_lines):
    return any(line.strip(" \t/*<!-").startswith(REASON) for line in comment_lines)


def leading_comment(lines):
    """The comment lines at the top of a file, blank lines left out."""
    head = []
    for line in lines:
        if line.strip() and not COMMENT.match(line):
            break
        head.append(line)
    return head


def without_raw_strings_and_comments(text):
    """The text with R"(...)" strings and block comments emptied and line comments removed; line numbers remain."""
    text = re.sub(r'R"(\w*)\(.*?\)\1"|/\*.*?\*/', lambda m: '""' + "\n" * m[0].count("\n"), text, flags=re.DOTALL)
    return re.sub(r"(?m)(^|[ \t])//.*", "", text)


def functions(text):
    """[(first line, last line, signature)] of the functions in code as clang-format writes it: a body begins with a line at
    namespace or class level that ends in "{", and ends at the next line that begins with "}" and has the same indentation."""
    lines = without_raw_strings_and_comments(text).splitlines()
    found, head_start, number = [], None, 0
    while number < len(lines):
        line = lines[number].rstrip()
        if not line or line.lstrip().startswith("#") or re.match(r"\s*(public|protected|private):$", line):
            head_start = None
        else:
            if head_start is None:
                head_start = number
            if line.endswith("{"):
                head = " ".join(part.strip() for part in lines[head_start:number + 1])
                indentation = re.match(r"\s*", lines[head_start])[0]
                scope = re.match(r"(template <.*> )?(inline )?(namespace|class|struct|union|extern \"C\")\b[^()=]*\{$", head)
                if not scope:  # a function, or an initializer or enumeration, which is passed over
                    first = head_start
                    while number + 1 < len(lines) and not re.match(rf"{indentation}\}}", lines[number]):
                        number += 1
                    if re.match(r"[^=(]*(\(|operator=|= \[)", head):
                        found.append((first + 1, number + 1, head))
                head_start = None
            elif line.endswith((";", "}", ":")) and not line.endswith("::"):
                head_start = None
        number += 1
    return found


def comment_above(lines, first):
    """The comment lines that end directly above the line with the number `first`."""
    start = first - 1
    while start > 0 and COMMENT.match(lines[start - 1]):
        start -= 1
    return lines[start:first - 1]


def product_files(source):
    return [path for folder in PRODUCT for path in sorted((source / folder).rglob("*"))
            if path.suffix in SUFFIXES and not FETCHED & set(path.parts)]


def long_files(source):
    broken = []
    for path in product_files(source):
        lines = path.read_text(encoding="utf-8").splitlines()
        if len(lines) > MAX_FILE_LINES and not has_reason(leading_comment(lines)):
            broken.append(f"{path.relative_to(source)} has {len(lines)} lines")
    return broken


def long_functions(source):
    broken = []
    for path in product_files(source):
        if path.suffix in (".h", ".cpp"):
            text = path.read_text(encoding="utf-8")
            broken += [f"{path.relative_to(source)}:{first} has {last - first + 1} lines: {head}" for first, last, head in functions(text)
                       if last - first >= MAX_FUNCTION_LINES and not has_reason(comment_above(text.splitlines(), first))]
    return broken


def crowded_folders(source):
    ideas = {}
    for path in product_files(source):
        ideas.setdefault(path.parent.relative_to(source), set()).add(path.name.partition(".")[0])
    return [f"{folder} has {len(names)} ideas: {' '.join(sorted(names))}" for folder, names in ideas.items() if len(names) > MAX_IDEAS]


@pytest.mark.parametrize("rule", [long_files, long_functions, crowded_folders])
def test_product(rule):
    broken = rule(SOURCE)
    assert not broken, "\n" + "\n".join(broken)


def write(source, name, text):
    path = source / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_long_file_is_found(tmp_path):
    body = "int x;\n" * 499
    write(tmp_path, "formats/a.h", f"// SPDX\n{body}")
    write(tmp_path, "formats/b.h", f"// SPDX\n\n{body}")
    write(tmp_path, "formats/c.h", f"// SPDX\n\n// Long because it is a table.\n{body}")
    write(tmp_path, "formats/d.h", f"// SPDX\n{body}// Long because the reason is not at the top.\n")
    write(tmp_path, "runtime/page/e.js", f"// SPDX\n{body}\n")
    write(tmp_path, "runtime/page/vendor/f.js", f"// SPDX\n{body}\n")
    assert long_files(tmp_path) == ["formats/b.h has 501 lines", "formats/d.h has 501 lines", "runtime/page/e.js has 501 lines"]


SAMPLE = '''// SPDX
#include <vector>

namespace trocar {
namespace {

constexpr Entry kTable[] = {
    {1, 2},
};

enum class Kind {
  kOne,
};

struct Options {
  int a = 0;
  Options(int b)
      : a(b) {
BODY
  }
  bool operator=(const Options& other) {
BODY
  }
};

// A comment.
template <typename T>
std::vector<T> free_function(T first,
                             int second = 3) {
  auto inner = [&](int x) {
BODY
  };
  if (first) {
BODY
  }
  return {};
}

const char* text() {
  return R"(
function of_another_language() {
}
)";
}

const auto kLambda = [](int x) {
BODY
};

}  // namespace

class Keeper final : public Options {
 public:
  int value() const { return 1; }
  ~Keeper() {
BODY
  }
};

}  // namespace trocar
'''


def test_functions_are_found():
    text = SAMPLE.replace("BODY", "  call();")
    lines = text.splitlines()
    found = [(lines[first - 1].strip(), last - first + 1) for first, last, _ in functions(text)]
    assert found == [("Options(int b)", 4), ("bool operator=(const Options& other) {", 3), ("template <typename T>", 11), ("const char* text() {", 6),
                     ("const auto kLambda = [](int x) {", 3), ("~Keeper() {", 3)]


def test_long_function_is_found(tmp_path):
    function = "void f(int a,\n       int b) {\n" + "  call();\n" * 97 + "}\n"
    longer = function.replace("}", "  call();\n}")
    write(tmp_path, "pipeline/a.cpp", f"// SPDX\nnamespace trocar {{\n\n{function}\n{longer}\n"
          f"// Reads it.\n// Long because it is a table of cases.\n{longer}\n// Long because of nothing.\n\n{longer}\n}}\n")
    assert long_functions(tmp_path) == [f"pipeline/a.cpp:{line} has 101 lines: void f(int a, int b) {{" for line in (105, 313)]


def test_crowded_folder_is_found(tmp_path):
    for number in range(20):
        for suffix in ("h", "cpp"):
            write(tmp_path, f"runtime/a/x{number}.{suffix}", "")
            write(tmp_path, f"runtime/b/x{number}.{suffix}", "")
    write(tmp_path, "runtime/a/x0.html", "")
    write(tmp_path, "runtime/b/one_more.h", "")
    assert [line.split(":")[0] for line in crowded_folders(tmp_path)] == ["runtime/b has 21 ideas"]
