// SPDX-License-Identifier: Apache-2.0
// The documents of documents.json: by name one that is good (the device's is the shipped one), and
// `wrong`: rows of a JSON pointer, the value that is set there (without one the key is removed) and
// what the message names, if it is not the pointer.
#pragma once

#include <fstream>
#include <nlohmann/json.hpp>

namespace trocar::test {

inline const nlohmann::json& documents() {
  static const nlohmann::json all = [] {
    std::ifstream file(TROCAR_DOCUMENTS), four_legs(TROCAR_FOUR_LEGS_JSON);
    nlohmann::json out = nlohmann::json::parse(file);
    out["device"]["good"] = nlohmann::json::parse(four_legs);
    return out;
  }();
  return all;
}

}  // namespace trocar::test
