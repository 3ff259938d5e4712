// SPDX-License-Identifier: GPL-3.0-or-later
// What differs between the assets of two stores, the worst first.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "pipeline/farm/stored_asset.h"

namespace trocar::pipeline {

/// Of the asset in the store, and of that in the other store.
template <typename T>
struct Both {
  T now{}, before{};
};

struct AssetDifference {
  /// Largest distance between the outlines of a slice, two-sided, over the slices that have
  /// material in both assets; where the planes differ, too, in the later asset's. Accurate to
  /// 0.001 mm.
  double hausdorff_mm = 0;
  int worst_slice = -1;  ///< where that is; -1 if there is no such slice
  int slices_changed = 0;
  Both<int> slices_alone;  ///< with material in one of the assets only
  Both<double> area_mm2;
  Both<std::uint64_t> triangles;
};
/// Slices correspond by index and material.
AssetDifference compare_assets(const Asset& now, const Asset& before);

struct ScanDifference {
  /// From worst to best.
  enum class Kind { kDamaged, kFailed, kGone, kChanged, kRepaired, kNew };
  std::string name;
  Kind kind = Kind::kChanged;
  std::string reason;        ///< of kDamaged and kFailed
  AssetDifference geometry;  ///< of kChanged
  Both<std::uint64_t> bytes;
};
/// "damaged", "failed" (and before it had not), "gone" (no entry any more), "changed", "repaired"
/// (failed before), "new".
const char* name_of(ScanDifference::Kind kind);

struct StoreDiff {
  std::size_t same = 0;  ///< scans with the same asset, byte by byte, or failed in both
  std::vector<ScanDifference> differences;
};
/// Only assets whose digests differ are read. Order: kind; material missing in either; distance;
/// difference of area, of triangles, of bytes; name. `stop`, if given, ends it early (unwritable).
Result<StoreDiff> compare_stores(const farm::Store& now, const farm::Store& before,
                                 const std::atomic<bool>* stop = nullptr);

}  // namespace trocar::pipeline
