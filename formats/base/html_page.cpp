// SPDX-License-Identifier: Apache-2.0
#include "formats/base/html_page.h"

#include <utility>

#include "embedded/formats/base/page.html.h"

namespace trocar {

std::string embedded_json(std::string_view json) {
  std::string out;
  for (const char c : json) {
    if (c == '<')
      out += "\\u003c";
    else
      out += c;
  }
  return out;
}

std::string html_page(std::string_view generator, std::string_view script,
                      std::initializer_list<EmbeddedDocument> documents) {
  std::string data;
  for (const EmbeddedDocument& document : documents) {
    data.append(R"(<script type="application/json" id=")").append(document.id).append("\">");
    data.append(embedded_json(document.json)).append("</script>\n");
  }
  using Part = std::pair<std::string_view, std::string_view>;
  std::string out;
  std::string_view rest = kPageTemplate;
  for (const auto& [mark, text] : {Part{"{{generator}}", generator}, Part{"{{documents}}", data},
                                   Part{"{{script}}", script}}) {
    const std::size_t at = rest.find(mark);
    out.append(rest.substr(0, at)).append(text);
    rest.remove_prefix(at + mark.size());
  }
  return out.append(rest);
}

}  // namespace trocar
