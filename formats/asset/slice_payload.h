// SPDX-License-Identifier: Apache-2.0
// Decodes a slice from its parts in the file: the JSON of its node, and its bytes. Used both for
// reading a whole file (asset_decode.cpp) and some slices of it (asset_part.cpp). Internal to
// formats/.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"

namespace trocar {

/// JSON text from a file; refused if it does not parse or is nested too deeply (recursion).
Result<nlohmann::json> parse_json_text(std::span<const std::uint8_t> text);

/// The `trocar` object of an element's extras, or null.
nlohmann::json trocar_extras(const nlohmann::json& extras);

/// Reads what the document's extras say of the whole asset into `asset`. Refused, with `name`, if
/// they are not an asset's.
Result<void> read_document_extras(const nlohmann::json& extras, Asset& asset,
                                  const std::string& name);

/// The slice without its geometry.
Result<AssetSlice> slice_of_node(const nlohmann::json& node);

struct GeometryBytes {
  std::span<const std::uint8_t> draco, outline, segments;
};
/// Decodes mesh and outline of a record that has triangles; refused if they differ from its counts
/// or its box. `bytes` have the sizes that the record states.
Result<void> decode_slice_geometry(const SliceRecord& record, const GeometryBytes& bytes,
                                   const Lattice& lattice, AssetSlice& slice);

}  // namespace trocar
