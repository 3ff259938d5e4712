// SPDX-License-Identifier: Apache-2.0
// The meshes of sheets in the form in which other processes read them (formats/session/telemetry.md).
// Tests: tests/runtime/session/live_session_test.cpp
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "formats/session/telemetry.h"
#include "runtime/contact/prefetch_worker.h"
#include "runtime/contact/sheet.h"
#include "runtime/sheet_mesh/triangle_grid.h"

namespace trocar::runtime {

/// A sheet before its first hole. A cut adds vertices without a HU value; theirs is interpolated in
/// the first mesh.
class FirstSheet {
 public:
  explicit FirstSheet(const Sheet& sheet);

  bool has_hu() const noexcept { return hu_ != nullptr; }
  /// The current version of the same sheet.
  TelemetrySheet published(const Sheet& sheet) const;

 private:
  float hu_at(LatticePoint point) const;

  SheetMesh mesh_;
  TriangleGrid grid_;
  std::shared_ptr<const std::vector<float>> hu_;  ///< one value for each vertex slot; null: none
};

/// `slices`: slice index of each sheet; a shape of another slice gets the sheet -1.
TelemetryShape published(const SheetShape& shape, const std::vector<std::int32_t>& slices);

}  // namespace trocar::runtime
