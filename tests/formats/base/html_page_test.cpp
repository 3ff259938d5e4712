// SPDX-License-Identifier: Apache-2.0
#include "formats/base/html_page.h"

#include <gtest/gtest.h>

namespace {

TEST(HtmlPage, HoldsEachDocumentAndTheScript) {
  const std::string page =
      trocar::html_page("a program", "show();", {{"a", R"({"a":"{{b}}{{script}}"})"}, {"b", "1"}});
  EXPECT_NE(page.find(R"(<meta name="generator" content="a program">)"), std::string::npos);
  EXPECT_NE(
      page.find("<script type=\"application/json\" id=\"a\">{\"a\":\"{{b}}{{script}}\"}</script>\n"
                "<script type=\"application/json\" id=\"b\">1</script>\n<script>\n"),
      std::string::npos);
  EXPECT_NE(page.find("\nshow();\n</script>\n</body>\n</html>\n"), std::string::npos);
}

TEST(HtmlPage, NoTextCanEndTheScriptElement) {
  EXPECT_EQ(trocar::embedded_json("[\"</script><!--\u2028\"]"),
            "[\"\\u003c/script>\\u003c!--\u2028\"]");
  const std::string page = trocar::html_page("", "", {{"a", R"("</script><script>")"}});
  EXPECT_EQ(page.find("</script><script>"), std::string::npos);
}

}  // namespace
