// SPDX-License-Identifier: GPL-3.0-or-later
// The files that `trocar-mesh export` writes for other programs.
// Tests: tests/e2e/assets_e2e_test.py
#pragma once

#include <atomic>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "formats/asset/asset.h"

namespace trocar::pipeline {

/// Writes for each slice with material `slice_NNNN.poly` (triangle_poly.h), `.obj` (mm, in the
/// patient's LPS frame) and `.svg`. If the asset has several materials, the files of material M are
/// `slice_NNNN_M.poly` and so on. The folder is created if needed, and an earlier export of the
/// same slices is replaced. Either all files appear or none. Returns the names of files that an
/// export of other slices has left in the folder. These files are kept, although they could be
/// mistaken for files of this asset. Errors: kUnwritable if a file cannot be written or `stop` was
/// set; kRefused if a mesh is not manifold.
Result<std::vector<std::string>> export_asset(const Asset& asset,
                                              const std::filesystem::path& folder,
                                              const std::atomic<bool>* stop = nullptr);

/// Is this the ending of a file with one surface: .stl, .ply or .obj?
bool is_surface_ending(std::string_view ending);

/// The surface as binary .stl, binary .ply or .obj (the latter two with normals): mm, in the
/// patient's LPS frame, counter-clockwise seen from outside. Errors: kRefused if the surface is not
/// manifold.
Result<std::string> surface_text(const TriangleSurface& surface, const std::string& ending);

/// Writes each surface as binary `.stl`, binary `.ply` and `.obj`, as surface_text() makes them.
/// The files are `surface.stl` and so on, or `surface_M.stl` for material M of several. Either all
/// files appear or none. Errors: those of export_asset(); kRefused if the asset has no surface.
Result<void> export_surfaces(const Asset& asset, const std::filesystem::path& folder,
                             const std::atomic<bool>* stop = nullptr);

}  // namespace trocar::pipeline
