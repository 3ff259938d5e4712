// SPDX-License-Identifier: GPL-3.0-or-later
// The differences between the assets of two stores, the most serious first.
// Tests: tests/e2e/review_test.py
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "pipeline/review/stored_asset.h"

namespace trocar::pipeline {

/// A value of the asset in the store (`now`) and of the asset in the other store (`before`).
template <typename T>
struct Both {
  T now{}, before{};
};

struct AssetDifference {
  /// The largest two-sided Hausdorff distance between the outlines of a slice in the two assets,
  /// over the slices with material in both. If the planes of a slice differ, the outlines are
  /// compared in the plane of the newer asset. Accurate to 0.001 mm.
  double hausdorff_mm = 0;
  int worst_slice = -1;    ///< slice with this distance; -1 if no slice has material in both
  int slices_changed = 0;  ///< slices whose outline or number of triangles differs
  Both<int> slices_alone;  ///< slices with material in only this one of the assets
  Both<double> area_mm2;
  Both<std::uint64_t> triangles;
};
/// Compares two assets, whose slices correspond by index and material.
AssetDifference compare_assets(const Asset& now, const Asset& before);

struct ScanDifference {
  /// Kinds of difference, the most serious first.
  enum class Kind { kDamaged, kFailed, kGone, kChanged, kRepaired, kNew };
  std::string name;
  Kind kind = Kind::kChanged;
  std::string reason;        ///< reason of kDamaged or kFailed
  AssetDifference geometry;  ///< differences of kChanged
  Both<std::uint64_t> bytes;
};
/// "damaged", "failed" (the scan had not failed before), "gone" (the scan has no entry any more),
/// "changed", "repaired" (the scan had failed before), "new".
const char* name_of(ScanDifference::Kind kind);

struct StoreDiff {
  std::size_t same = 0;  ///< number of scans whose assets are byte-identical or that failed in both
  std::vector<ScanDifference> differences;
};
/// Compares two stores. Reads only assets whose digests differ. The differences are ordered by
/// kind, then by the number of slices with material in only one asset, then by distance, then by
/// the difference of area, of triangles and of bytes, then by name. Errors: kUnwritable if `stop`
/// was set; the comparison then ends early.
Result<StoreDiff> compare_stores(const farm::Store& now, const farm::Store& before,
                                 const std::atomic<bool>* stop = nullptr);

}  // namespace trocar::pipeline
