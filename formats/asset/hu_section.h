// SPDX-License-Identifier: Apache-2.0
// Writes volumes of HU into an asset file, and reads them. The JSON has one element of the array
// `extras.trocar.hu_volumes` for each volume. The bytes of a volume are a buffer view, which begins
// with a directory: one record for each plane. Internal to formats/. asset.md has the layout.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/gltf_writer.h"
#include "formats/base/file_io.h"

namespace trocar {

/// The location of a volume in the file, according to the document's extras.
struct HuSection {
  HuGrid grid;
  std::uint32_t view = 0;               ///< number of the buffer view
  std::uint64_t offset = 0, bytes = 0;  ///< location of the view in the binary chunk's data
  std::uint32_t planes = 0;             ///< number of planes
};

/// Appends a volume's buffer view, and returns the volume's element of `hu_volumes`. Precondition:
/// the planes ascend by index.
nlohmann::json add_hu_volume(GltfWriter& gltf, const EncodedHuVolume& volume);

/// Returns the volumes that `ours`, a document's `extras.trocar`, describes: at most one volume of
/// the material with a margin, and at most one of everything. Errors: kRefused if a volume has an
/// unknown version or a number out of range, or if two volumes are of the same kind.
Result<std::vector<HuSection>> hu_sections(const nlohmann::json& ours, const Lattice& lattice);

/// Decodes planes of HU into asset.hu and, if `with_context` is set, also into asset.context.
/// Decodes only the planes of the slices in asset.slices. A slice without outlines gets no plane in
/// asset.hu. The binary chunk's data begin at offset `binary_at` of `source` and have
/// `binary_bytes` bytes. For each slice only the bytes of its planes and O(log planes) records of
/// the directory are read. Errors: kRefused if bytes are damaged or lie outside the binary chunk,
/// or if there are more samples than max_hu_samples() (hu_codec.h).
Result<void> read_hu_volumes(ByteSource& source, std::uint64_t binary_at,
                             std::uint64_t binary_bytes, const std::vector<HuSection>& sections,
                             bool with_context, Asset& asset);

/// Checks a whole directory. `is_whole`: the asset has the outlines of all its slices. Errors:
/// kRefused if the planes do not ascend by index, do not fill the buffer view, or belong to slices
/// that the asset does not have. If `is_whole` is set and the volume has a margin, also kRefused if
/// a plane has bytes but its slice has no outline: no reader would read these bytes.
Result<void> check_hu_directory(ByteSource& source, std::uint64_t binary_at,
                                const HuSection& section, bool is_whole, const Asset& asset);

}  // namespace trocar
