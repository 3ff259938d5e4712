// SPDX-License-Identifier: Apache-2.0
// The glTF elements of an asset: primitives, materials, transforms and nodes of surfaces. Internal
// to formats/.
// Tests: tests/formats/asset/asset_page_test.py
#pragma once
#include <Eigen/Geometry>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/gltf_writer.h"

namespace trocar {

inline constexpr const char* kUnlitExtension = "KHR_materials_unlit";

/// A number for the JSON text. A whole number is written without a fraction, which is shorter.
nlohmann::json number(double value);
/// Sets the node's `matrix` or `translation`, in lattice steps. For the identity it sets neither.
void put_transform(const Eigen::Affine3d& T_mm, const Lattice& lattice, nlohmann::json& node);

/// The primitive of a slice's triangles at the height of z steps. Adds its payload and accessors to
/// `gltf`, and notes them in `sizes` and `record`.
nlohmann::json triangles_primitive(GltfWriter& gltf, const EncodedSlice& slice, std::int32_t z,
                                   AssetSizes& sizes, EntryRecord& record);
/// The primitive of an outline as lines, for viewers.
nlohmann::json lines_primitive(GltfWriter& gltf, const Pslg& pslg, std::int32_t z,
                               std::size_t material, AssetSizes& sizes);
/// The asset's materials, and the outline's if there are lines.
nlohmann::json gltf_materials(const Asset& head);
/// Adds a surface and returns its node's number. The node is not below the scan's node, so that
/// readers of slices ignore it. Errors: (bug) the payload, decoded again, is not a valid surface.
Result<int> add_surface(GltfWriter& gltf, const AssetSurface& one, AssetSizes& sizes);

}  // namespace trocar
