// SPDX-License-Identifier: Apache-2.0
// Converts the meshes of sheets to the form in which other processes read them
// (formats/session/telemetry.md).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "formats/session/telemetry.h"
#include "runtime/contact/prefetch_worker.h"
#include "runtime/contact/sheet.h"
#include "runtime/sheet_mesh/triangle_grid.h"

namespace trocar::runtime {

/// The mesh of a sheet before its first hole. Later versions of the sheet get their HU from this
/// first mesh. When a hole is cut, vertices are added for which the asset has no HU. Their HU is
/// interpolated in the first mesh.
class FirstSheet {
 public:
  explicit FirstSheet(const Sheet& sheet);

  bool has_hu() const noexcept { return hu_ != nullptr; }
  /// Converts this sheet with the holes that it has now. If has_hu() is true, the result has the HU
  /// of all vertices.
  TelemetrySheet published(const Sheet& sheet) const;

 private:
  float hu_at(LatticePoint point) const;

  SheetMesh mesh_;
  TriangleGrid grid_;
  std::shared_ptr<const std::vector<float>> hu_;  ///< one HU for each vertex of mesh_; null: none
};

/// Converts a shape, which is the deformed sheet around the tool. `slices`: the slice index of each
/// sheet. If the shape's slice is not in `slices`, TelemetryShape::sheet of the result is -1.
TelemetryShape published(const SheetShape& shape, const std::vector<std::int32_t>& slices);

}  // namespace trocar::runtime
