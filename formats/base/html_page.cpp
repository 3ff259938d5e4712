// SPDX-License-Identifier: Apache-2.0
#include "formats/base/html_page.h"

#include <stdexcept>

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

std::string html_page(std::string_view page_template,
                      std::initializer_list<EmbeddedDocument> documents) {
  std::string out;
  for (const EmbeddedDocument& document : documents) {
    const std::string mark = "{{" + std::string(document.name) + "}}";
    const std::size_t at = page_template.find(mark);
    if (at == std::string_view::npos) throw std::logic_error("the page's template has no " + mark);
    out += page_template.substr(0, at);
    page_template.remove_prefix(at + mark.size());
    out += embedded_json(document.json);
  }
  return out.append(page_template);
}

}  // namespace trocar
