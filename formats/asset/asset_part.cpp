// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/asset/hu_section.h"
#include "formats/asset/slice_payload.h"
#include "formats/base/file_io.h"

namespace trocar {
namespace {

Error no_such_slice(const std::string& name, int index, std::size_t slices, int first, int last) {
  return refused(name + ": slice " + std::to_string(index) + ": the asset has no such slice" +
                 (slices == 0
                      ? std::string(" (it has none)")
                      : " (it has " + std::to_string(first) + " to " + std::to_string(last) + ")"));
}

Result<AssetSlice> read_slice(ByteSource& source, const IndexedFile& file,
                              const EntryRecord& record, const Lattice& lattice,
                              const Eigen::Affine3d& frame) {
  const auto bytes = read_slice_bytes(source, file, record);
  if (!bytes) return bytes.error();
  const auto node = parse_json_text(bytes->node);
  if (!node) return node.error();
  const auto entry = entry_of_node(*node, lattice);
  if (!entry) return entry.error();
  AssetSlice geometry;
  std::int32_t z = 0;
  if (!record.is_empty()) {
    const auto decoded = decode_slice_geometry(bytes->draco, geometry);
    if (!decoded) return decoded.error();
    z = decoded->z;
  }
  auto slice = slice_of_entry(*entry, record.index, record.material, frame, lattice.to_mm(z));
  if (!slice) return slice;
  slice->mesh = std::move(geometry.mesh);
  slice->pslg = std::move(geometry.pslg);
  slice->hu = std::move(geometry.hu);
  return slice;
}

Result<AssetPart> read_by_index(ByteSource& source, const IndexedFile& file,
                                const std::vector<int>& slice_indices, const std::string& name) {
  const IndexHeader& header = file.header;
  AssetPart part;
  const auto text = read_document_texts(source, file);
  if (!text) return refused(name + ": " + text.error().message);
  const auto extras = parse_json_text(text->extras);
  if (!extras) return refused(name + ": " + extras.error().message);
  const auto slices = read_document_extras(*extras, part.asset, name);
  if (!slices) return slices.error();
  part.asset_slices = *slices;
  const auto node = parse_json_text(text->frame);
  const auto frame =
      node ? transform_of_node(*node, part.asset.lattice) : Result<Eigen::Affine3d>(node.error());
  if (!frame) return refused(name + ": " + frame.error().message);
  for (const int index : slice_indices) {
    const auto records = find_records(source, file, index);
    if (!records) return refused(name + ": " + records.error().message);
    if (records->empty())
      return no_such_slice(name, index, header.entries, header.first_index, header.last_index);
    for (const EntryRecord& record : *records) {
      auto slice = record.material < part.asset.materials.size()
                       ? read_slice(source, file, record, part.asset.lattice, *frame)
                       : refused("the slice index names a material that is not there");
      if (!slice) {
        return refused(name + ": slice " + std::to_string(index) + ": " + slice.error().message);
      }
      part.asset.slices.push_back(std::move(*slice));
    }
  }
  const auto volumes = hu_sections(trocar_extras(*extras), part.asset.lattice);
  if (!volumes) return refused(name + ": " + volumes.error().message);
  if (auto ok =
          read_hu_volumes(source, file.binary_at, header.binary_bytes, *volumes, false, part.asset);
      !ok)
    return refused(name + ": " + ok.error().message);
  return part;
}

Result<AssetPart> read_whole(ByteSource& source, const std::vector<int>& slice_indices,
                             const std::string& name) {
  std::vector<std::uint8_t> glb(static_cast<std::size_t>(source.size()));
  if (auto ok = source.read(0, glb); !ok) return refused(name + ": " + ok.error().message);
  auto asset = decode_asset(glb, name, {false, slice_indices});
  if (!asset) return asset.error();
  AssetPart part;
  part.asset_slices = slice_count(*asset);
  std::vector<AssetSlice> all = std::exchange(asset->slices, {});
  part.asset = std::move(*asset);
  for (const int index : slice_indices) {
    auto found = std::find_if(all.begin(), all.end(),
                              [index](const AssetSlice& slice) { return slice.index == index; });
    if (found == all.end())
      return no_such_slice(name, index, all.size(), all.empty() ? 0 : all.front().index,
                           all.empty() ? 0 : all.back().index);
    for (; found != all.end() && found->index == index; ++found)
      part.asset.slices.push_back(std::move(*found));
  }
  return part;
}

Result<AssetPart> read_part(ByteSource& source, std::vector<int> slice_indices,
                            const std::string& name) {
  std::sort(slice_indices.begin(), slice_indices.end());
  slice_indices.erase(std::unique(slice_indices.begin(), slice_indices.end()), slice_indices.end());
  if (source.size() > std::numeric_limits<std::uint32_t>::max())
    return refused(name + ": larger than a .glb can be");
  const auto index = find_index(source);
  if (!index) return refused(name + ": " + index.error().message);
  auto part = *index ? read_by_index(source, **index, slice_indices, name)
                     : read_whole(source, slice_indices, name);
  if (!part) return part;
  part->file_bytes = source.size();
  part->read_bytes = source.bytes_read();
  return part;
}

}  // namespace

Result<AssetPart> read_asset_part(const std::filesystem::path& file,
                                  std::vector<int> slice_indices) {
  const auto source = open_file(file);
  if (!source) return source.error();
  return read_part(**source, std::move(slice_indices), file.string());
}

Result<AssetPart> decode_asset_part(std::span<const std::uint8_t> glb, const std::string& name,
                                    std::vector<int> slice_indices) {
  MemorySource source(glb);
  return read_part(source, std::move(slice_indices), name);
}

}  // namespace trocar
