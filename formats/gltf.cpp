// SPDX-License-Identifier: Apache-2.0
#define TINYGLTF_IMPLEMENTATION
#include "formats/gltf.h"

namespace trocar {

nlohmann::json to_json(const tinygltf::Value& v) {
  if (v.IsBool()) return v.Get<bool>();
  if (v.IsInt()) return v.Get<int>();
  if (v.IsReal()) return v.Get<double>();
  if (v.IsString()) return v.Get<std::string>();
  if (v.IsArray()) {
    nlohmann::json out = nlohmann::json::array();
    for (std::size_t i = 0; i < v.ArrayLen(); ++i)
      out.push_back(to_json(v.Get(static_cast<int>(i))));
    return out;
  }
  if (v.IsObject()) {
    nlohmann::json out = nlohmann::json::object();
    for (const std::string& key : v.Keys())
      out[key] = to_json(v.Get(key));
    return out;
  }
  return nullptr;
}

}  // namespace trocar
