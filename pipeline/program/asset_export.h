// SPDX-License-Identifier: GPL-3.0-or-later
// Writes the files of `trocar-mesh export`, for other programs.
#pragma once

#include <atomic>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

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

}  // namespace trocar::pipeline
