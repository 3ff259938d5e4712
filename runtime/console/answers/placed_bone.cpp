// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/answers/placed_bone.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "formats/asset/asset_index.h"
#include "formats/asset/one_sheet.h"
#include "formats/base/file_io.h"

namespace trocar::runtime {
namespace {

constexpr std::uint64_t kMaxAssetBytes = std::uint64_t{1} << 30,
                        kMaxGlbJson = std::uint64_t{64} << 20;
// Two slices lie relative to each other as in the scan if they differ from it by no more than this.
constexpr double kMaxAside_mm = 0.02, kMaxApart_m = 2e-5, kMaxTurned = 1e-4;

bool is_of_scene(const Scene& scene, int index) {
  return (scene.body && index >= scene.body->from && index <= scene.body->to) ||
         std::any_of(scene.slices.begin(), scene.slices.end(),
                     [index](const SceneSlice& slice) { return slice.index == index; });
}

/// Returns true if the asset with this JSON text has a surface for display.
bool has_surface(std::string_view glb_json) {
  // Texts from a scan cannot contain this key with unescaped quotes. A false positive would
  // only cost time.
  return glb_json.find("\"surface\":") != std::string_view::npos;
}

}  // namespace

Result<std::string> glb_json(const std::filesystem::path& file) {
  Result<std::unique_ptr<ByteSource>> source = open_file(file);
  if (!source) return source.error();
  const Result<std::uint32_t> size = json_bytes_of(**source);
  if (!size) return refused(file.string() + ": " + size.error().message);
  if (*size > kMaxGlbJson) return refused(file.string() + ": its JSON is larger than 64 MiB");
  std::string text(*size, '\0');
  const std::span<std::uint8_t> into(reinterpret_cast<std::uint8_t*>(text.data()), text.size());
  if (const auto read = (*source)->read(kGlbHeader, into); !read) return read.error();
  return text;
}

Result<PlacedBone> load_bone(const std::filesystem::path& scene_file,
                             const std::filesystem::path& asset, BoneParts parts) {
  PlacedBone loaded;
  Result<Scene> scene = read_scene(scene_file);
  if (!scene) return scene.error();
  loaded.scene = std::move(*scene);
  if (!asset.empty()) loaded.scene.asset = asset;
  const std::string name = loaded.scene.asset.string();
  const Result<std::string> text = glb_json(loaded.scene.asset);
  if (!text) return text.error();
  if (parts == BoneParts::kWithVolumes || has_surface(*text)) {
    const auto bytes = read_file(loaded.scene.asset, kMaxAssetBytes);
    if (!bytes) return bytes.error();
    Result<Asset> whole = decode_asset(*bytes, name);
    if (!whole) return whole.error();
    loaded.surfaces = std::move(whole->surfaces);
    loaded.asset = std::move(*whole);
    if (parts == BoneParts::kForView) add_hu_at_vertices(loaded.asset);
    loaded.all = loaded.asset.slices;
    std::erase_if(loaded.asset.slices,
                  [&](const AssetSlice& slice) { return !is_of_scene(loaded.scene, slice.index); });
  } else {
    std::vector<int> indices;
    for (const SceneSlice& slice : loaded.scene.slices)
      indices.push_back(slice.index);
    if (const auto& body = loaded.scene.body) {
      for (int index = body->from; index <= body->to; ++index)
        indices.push_back(index);
    }
    Result<AssetPart> part = read_asset_part(loaded.scene.asset, std::move(indices));
    if (!part) return part.error();
    loaded.asset = std::move(part->asset);
    add_hu_at_vertices(loaded.asset);
  }
  if (const auto ok = weld_materials(loaded.asset, name); !ok) return ok.error();
  if (const auto ok = place_body(loaded.scene, loaded.asset, name); !ok) return ok.error();
  auto sheets = place_slices(loaded.scene, loaded.asset, name);
  if (!sheets) return sheets.error();
  loaded.sheets = std::move(*sheets);
  return loaded;
}

const AssetSlice& slice_of(const Asset& asset, int index) {
  return *std::find_if(asset.slices.begin(), asset.slices.end(),
                       [index](const AssetSlice& slice) { return slice.index == index; });
}

Result<Eigen::Affine3d> plane_of_surface(const PlacedBone& loaded) {
  const Sheet& top = *loaded.sheets.front();
  const Eigen::Affine3d T_plane_lps = slice_of(loaded.asset, top.slice_index).T_lps_plane.inverse();
  for (const auto& sheet : loaded.sheets) {
    const Eigen::Affine3d between =
        T_plane_lps * slice_of(loaded.asset, sheet->slice_index).T_lps_plane;
    const Eigen::Vector3d shift = between.translation();
    // A scene puts slices straight above each other, so this is the same in all of its scenes.
    if (!between.linear().isIdentity(kMaxTurned) || !(shift.head<2>().norm() < kMaxAside_mm))
      return refused("The scan's slices are not straight above each other (a tilted gantry).");
    if (!(std::abs(shift.z() * 1e-3 - (sheet->z_m - top.z_m)) < kMaxApart_m))
      return refused("The scene's slices are not as far apart as in the scan.");
  }
  return T_plane_lps;
}

Result<Eigen::Affine3d> device_of_patient(const PlacedBone& loaded) {
  const auto T_plane_lps = plane_of_surface(loaded);
  if (!T_plane_lps) return T_plane_lps.error();
  const Sheet& top = *loaded.sheets.front();
  const auto in_device = [&](const Eigen::Vector3d& lps_mm) {
    const Eigen::Vector3d at = *T_plane_lps * lps_mm;
    const Eigen::Vector2d xy =
        top.transform.to_scene(at.head<2>() / top.transform.lattice.step_mm());
    return Eigen::Vector3d(xy.x(), xy.y(), top.z_m + at.z() * 1e-3);
  };
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  T.translation() = in_device(Eigen::Vector3d::Zero());
  for (int axis = 0; axis < 3; ++axis)
    T.linear().col(axis) = in_device(Eigen::Vector3d::Unit(axis)) - T.translation();
  return T;
}

}  // namespace trocar::runtime
