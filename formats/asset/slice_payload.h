// SPDX-License-Identifier: Apache-2.0
// A slice of an asset from what the file holds of it: the JSON of its node, and its bytes. The
// readers of a whole file and of a part of one share it. Internal to formats/.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"

namespace trocar {

/// JSON text from a file; refused if it does not parse or is nested so deeply that working on it
/// would recurse too far.
Result<nlohmann::json> parse_json_text(std::span<const std::uint8_t> text);

/// The `trocar` object of an element's extras, or null.
nlohmann::json our_extras(const nlohmann::json& extras);

/// What the document's extras say of the asset as a whole; refused, with `name`, if they are not
/// ours.
Result<void> take_head(const nlohmann::json& extras, Asset& asset, const std::string& name);

/// The slice without its geometry.
Result<AssetSlice> slice_of_node(const nlohmann::json& node);

struct GeometryBytes {
  std::span<const std::uint8_t> draco, outline, segments;
};
/// Decodes mesh and outline of a record with triangles, and holds them against its counts and its
/// box. `bytes` have the sizes that the record says.
Result<void> take_geometry(const SliceRecord& record, const GeometryBytes& bytes,
                           const Lattice& lattice, AssetSlice& slice);

}  // namespace trocar
