// SPDX-License-Identifier: Apache-2.0
#define TINYGLTF_IMPLEMENTATION
#include "formats/gltf.h"

#include <cstdint>
#include <limits>
#include <utility>

namespace trocar {

tinygltf::Value to_value(const nlohmann::json& j) {
  using tinygltf::Value;
  if (j.is_boolean()) return Value(j.get<bool>());
  if (j.is_number_integer()) {
    const auto i = j.get<std::int64_t>();
    if (i >= std::numeric_limits<int>::min() && i <= std::numeric_limits<int>::max()) {
      return Value(static_cast<int>(i));
    }
    return Value(static_cast<double>(i));
  }
  if (j.is_number()) return Value(j.get<double>());
  if (j.is_string()) return Value(j.get<std::string>());
  if (j.is_array()) {
    Value::Array array;
    for (const nlohmann::json& e : j)
      array.push_back(to_value(e));
    return Value(std::move(array));
  }
  if (j.is_object()) {
    Value::Object object;
    for (const auto& [key, e] : j.items())
      object[key] = to_value(e);
    return Value(std::move(object));
  }
  return {};
}

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
