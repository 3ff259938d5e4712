// SPDX-License-Identifier: Apache-2.0
// HTML pages that the programs write. A page is a template with styles and a script. The script
// renders JSON documents that are embedded in the page. A page needs no other file and no network.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

namespace trocar {

struct EmbeddedDocument {
  std::string_view name;
  std::string_view json;
};

/// Returns JSON as it stands in a page: each `<` is written as \u003c, so that no document can end
/// its own script element.
std::string embedded_json(std::string_view json);

/// Returns the template with each mark `{{name}}` replaced by the embedded_json() of that name.
/// Preconditions: each mark stands in a `<script type="application/json">`; the marks have the same
/// order in the template as the documents in `documents`; the template's script sets texts by
/// `textContent` only, so that no text becomes HTML. Throws std::logic_error if the template has no
/// mark for a document.
std::string html_page(std::string_view page_template,
                      std::initializer_list<EmbeddedDocument> documents);

}  // namespace trocar
