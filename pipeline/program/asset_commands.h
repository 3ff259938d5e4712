// SPDX-License-Identifier: GPL-3.0-or-later
// Describes an asset, for `trocar-mesh info`.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// The JSON that `info` prints (formats/session/info.schema.json). For each slice and material, it
/// has the position, the numbers of vertices, triangles and rings, and the area, bounding box,
/// centroid and mean HU. For the asset it has the parameters, the area of each material over all
/// slices, the surfaces, and the grids on which the asset stores HU (one for the material, one for
/// the context). `bytes` is the size of the asset's file.
nlohmann::json describe_asset(const Asset& asset, std::uint64_t bytes);

// Writes the files of `trocar-mesh export`, for other programs.

/// Writes three files for each slice with material: `slice_NNNN.poly` (triangle_poly.h),
/// `slice_NNNN.obj` (mm, in the patient's LPS frame) and `slice_NNNN.svg`. NNNN is the slice's
/// index. If the asset has several materials, the files of material M are `slice_NNNN_M.poly` and
/// so on. The folder is created if needed, and files of the same names are replaced. If a file
/// cannot be made, for example because a folder has its name, no file in `folder` is changed.
///
/// Returns the names of files in the folder that are named like exported slices, but do not belong
/// to this export: an earlier export of other slices has written them. The function keeps these
/// files. The caller should warn the user, who could take them for files of this asset.
///
/// Errors: kUnwritable if a file cannot be written or `stop` was set; kRefused if a mesh is not
/// manifold (for example, if an edge has more than two triangles); those of poly_text().
Result<std::vector<std::string>> export_asset(const Asset& asset,
                                              const std::filesystem::path& folder,
                                              const std::atomic<bool>* stop = nullptr);

/// Is `ending` one that surface_text() accepts: ".stl", ".ply" or ".obj"?
bool is_surface_ending(std::string_view ending);

/// The contents of a file with the surface: binary .stl, binary .ply or .obj, as `ending` says.
/// Coordinates are in mm in the patient's LPS frame. Triangles are counter-clockwise seen from
/// outside. The .ply and the .obj also have a normal for each vertex. Errors: kRefused if the
/// surface is not manifold.
Result<std::string> surface_text(const TriangleSurface& surface, const std::string& ending);

/// Writes each surface in the three formats of surface_text(), to `surface.stl`, `surface.ply` and
/// `surface.obj`. If the asset has several surfaces, the files of material M are `surface_M.stl`
/// and so on. If a file cannot be made, for example because a folder has its name, no file
/// in `folder` is changed.
/// Errors: kUnwritable if a file cannot be written or `stop` was set; kRefused if the asset has no
/// surface, or if a surface is not manifold.
Result<void> export_surfaces(const Asset& asset, const std::filesystem::path& folder,
                             const std::atomic<bool>* stop = nullptr);

// A slice's outline in the format of Shewchuk's program Triangle (.poly).

/// The contents of the file: the outline's vertices and segments in mm in the slice plane, and a
/// point inside each hole, by which Triangle recognises the hole. To find these points, the
/// function triangulates the holes. Errors: those of triangulate().
Result<std::string> poly_text(const AssetSlice& slice, const Lattice& lattice);

}  // namespace trocar::pipeline

// `trocar-mesh info`: prints what an asset contains.

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct InfoArguments {
  std::filesystem::path asset;
  bool as_json = false;
};

/// Declares the options. Parsing writes their values to `a`.
void add_info_options(CLI::App& command, InfoArguments& a);

/// Prints the description and returns the exit code.
int run_info(const InfoArguments& a);

}  // namespace trocar::pipeline

// `trocar-mesh verify`: checks whether assets are valid (verify_asset() in formats/asset/asset.h).

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct VerifyArguments {
  std::vector<std::filesystem::path> assets;
  bool as_json = false;
  bool with_cgal = false;  ///< also verifies every slice with CGAL
  /// Also refuses texts that may identify the patient, and HU around the material (--context).
  bool deidentified = false;
};

/// Declares the options. Parsing writes their values to `a`.
void add_verify_options(CLI::App& command, VerifyArguments& a);

/// Checks every asset and prints the outcome. Returns 0 if all assets are valid, otherwise the exit
/// code of the first failure.
int run_verify(const VerifyArguments& a);

}  // namespace trocar::pipeline

// `trocar-mesh export`: writes an asset's slices or surfaces for other programs.

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct ExportArguments {
  std::filesystem::path asset, folder;
  bool surface = false;  ///< writes the surfaces instead of the slices
};

/// Declares the options. Parsing writes their values to `a`.
void add_export_options(CLI::App& command, ExportArguments& a);

/// Verifies the asset, writes the files and returns the exit code.
int run_export(const ExportArguments& a);

}  // namespace trocar::pipeline
