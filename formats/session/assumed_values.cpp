// SPDX-License-Identifier: Apache-2.0
#include "formats/session/assumed_values.h"

#include <string>

namespace trocar {

void check_assumed(const nlohmann::json& assumed, const nlohmann::json& document,
                   JsonErrors& errors) {
  using Json = nlohmann::json;
  if (!assumed.is_object()) return errors.add("/assumed", "must be an object");
  for (const auto& [pointer, reason] : assumed.items()) {
    const std::string path =
        "/assumed " +
        Json(pointer.substr(0, 64)).dump(-1, ' ', true, Json::error_handler_t::replace);
    if (!reason.is_string()) errors.add(path, "must be a string");
    bool names_a_value = false;
    try {
      names_a_value = document.contains(Json::json_pointer(pointer));
    } catch (const Json::exception&) {  // not a pointer
    }
    if (!names_a_value) errors.add(path, "names no value of this file");
  }
}

}  // namespace trocar
