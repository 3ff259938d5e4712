// SPDX-License-Identifier: Apache-2.0
// The glTF elements of an asset: primitives, materials, transforms and nodes of surfaces. Internal
// to formats/.
#pragma once
#include <Eigen/Geometry>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/gltf_writer.h"

namespace trocar {

inline constexpr const char* kUnlitExtension = "KHR_materials_unlit";

/// A number for the JSON text. A whole number is written without ".0", which is shorter.
nlohmann::json number(double value);
/// Writes a transform into `node`: a pure translation as `translation`, any other transform as
/// `matrix`. The identity is not written. Lengths are in mm in `T_mm` and in lattice steps in the
/// node's JSON.
void put_transform(const Eigen::Affine3d& T_mm, const Lattice& lattice, nlohmann::json& node);

/// Returns the primitive of a slice's triangles, which lie at a height of z steps. Adds the Draco
/// payload and the accessors to `gltf`, counts the triangles and the payload's bytes in `sizes`,
/// and stores the payload's location in `record`.
nlohmann::json triangles_primitive(GltfWriter& gltf, const EncodedSlice& slice, std::int32_t z,
                                   AssetSizes& sizes, EntryRecord& record);
/// Returns a primitive that shows an outline as lines, for viewers. Adds the lines to `gltf` and
/// counts their bytes in `sizes`. `material` is the number of the glTF material of outlines.
nlohmann::json lines_primitive(GltfWriter& gltf, const Pslg& pslg, std::int32_t z,
                               std::size_t material, AssetSizes& sizes);
/// Returns the glTF materials: one for each material of the asset and, if the file holds outlines
/// as lines, one for the outlines.
nlohmann::json gltf_materials(const Asset& head);
/// Adds a surface and returns the number of its node. All slices are below node 0. The surface's
/// node is not, so readers of slices ignore the surface. Errors: those of encode_surface(); kBug if
/// the payload does not decode to a valid surface.
Result<int> add_surface(GltfWriter& gltf, const AssetSurface& one, AssetSizes& sizes);

}  // namespace trocar
