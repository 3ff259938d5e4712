// SPDX-License-Identifier: Apache-2.0
#include "formats/base/html_page.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace {

TEST(HtmlPage, ReplacesEachMarkByItsDocument) {
  EXPECT_EQ(trocar::html_page("<p>{{a}}<p>{{b}}</p>", {{"a", R"({"a":"{{b}}"})"}, {"b", "1"}}),
            R"(<p>{"a":"{{b}}"}<p>1</p>)");
  EXPECT_THROW(trocar::html_page("<p></p>", {{"a", "{}"}}), std::logic_error);
}

TEST(HtmlPage, NoTextCanEndTheScriptElement) {
  EXPECT_EQ(trocar::html_page("[{{a}}]", {{"a", R"("</script><!--")"}}),
            R"(["\u003c/script>\u003c!--"])");
}

}  // namespace
