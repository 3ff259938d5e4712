// SPDX-License-Identifier: Apache-2.0
// What the two halves of the asset codec share of tinygltf. Internal to formats/: every file that
// includes this is compiled with hidden visibility, since Debian's libdraco exports a tinygltf of
// its own, built with other options, that must not be mixed with ours.
#pragma once

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#include <tiny_gltf.h>

#include <nlohmann/json.hpp>

namespace trocar {

inline constexpr const char* kDracoExtension = "KHR_draco_mesh_compression";
inline constexpr const char* kUnlitExtension = "KHR_materials_unlit";

/// JSON as tinygltf's own value type and back. Integers beyond int become doubles.
tinygltf::Value to_value(const nlohmann::json& j);
nlohmann::json to_json(const tinygltf::Value& v);

}  // namespace trocar
