// SPDX-License-Identifier: Apache-2.0
// Volumes of HU in the file: a buffer view for each, which begins with a directory of its planes, and an element of
// `hu_volumes` in the document's extras. Internal to formats/. asset.md has the layout.
// Tests: tests/formats/asset/hu_volume_test.cpp
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/gltf_writer.h"
#include "formats/base/file_io.h"

namespace trocar {

/// The location of a volume in the file, as the document's extras state it.
struct HuSection {
  HuGrid grid;
  std::uint32_t view = 0;               ///< number of its buffer view
  std::uint64_t offset = 0, bytes = 0;  ///< in the binary chunk's data
  std::uint32_t planes = 0;
};

/// Appends a volume's buffer view. Returns its element of `hu_volumes`. Expects planes that ascend by index.
nlohmann::json add_hu_volume(GltfWriter& gltf, const EncodedHuVolume& volume);

/// The volumes in a document's `extras.trocar`: at most one around the material and one of everything. Errors:
/// (refused) other versions, numbers out of range.
Result<std::vector<HuSection>> hu_sections(const nlohmann::json& ours, const Lattice& lattice);

/// Decodes the planes of asset.slices into asset.hu and, if `with_context`, asset.context. Slices without outlines
/// have no plane in asset.hu. `source` has the binary chunk's data, `binary_bytes` long, from `binary_at` on. Only
/// the planes' bytes and O(log planes) records of the directory are read for each slice. Errors: (refused).
Result<void> read_hu_volumes(ByteSource& source, std::uint64_t binary_at,
                             std::uint64_t binary_bytes, const std::vector<HuSection>& sections,
                             bool with_context, Asset& asset);

/// Checks a whole directory: its planes ascend, belong to slices of the asset and fill the view. Errors: (refused).
Result<void> check_hu_directory(ByteSource& source, std::uint64_t binary_at,
                                const HuSection& section, const Asset& asset);

}  // namespace trocar
