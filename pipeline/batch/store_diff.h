// SPDX-License-Identifier: GPL-3.0-or-later
// The differences between the assets of two stores, the most serious first.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "pipeline/batch/review.h"

namespace trocar::pipeline {

/// A value in the reviewed store (`now`), and the same value in the store to compare with
/// (`before`).
template <typename T>
struct Both {
  T now{}, before{};
};

/// The differences between two assets. Slices with material correspond to each other if their index
/// and material are equal. In the numbers of slices, each material of a slice counts as a slice.
struct AssetDifference {
  /// The largest two-sided Hausdorff distance between the outlines of corresponding slices,
  /// accurate to 0.001 mm. If the planes of two slices differ, the outline of `before` is projected
  /// onto the plane of `now`. The distance of these two slices is then the larger of two numbers:
  /// the Hausdorff distance in the plane of `now`, and the largest distance between a point of the
  /// outline of `before` and the point's projection.
  double hausdorff_mm = 0;
  int worst_slice = -1;    ///< index of the slice with hausdorff_mm; -1 if no slices correspond
  int slices_changed = 0;  ///< corresponding slices whose outlines or numbers of triangles differ
  Both<int> slices_alone;  ///< slices with material that have no corresponding slice
  Both<double> area_mm2;
  Both<std::uint64_t> triangles;
};

/// The number of triangles of all slices.
std::uint64_t triangles_of(const Asset& asset);

struct ScanDifference {
  /// Kinds of difference, the most serious first.
  enum class Kind { kDamaged, kFailed, kGone, kChanged, kRepaired, kNew };
  std::string name;
  Kind kind = Kind::kChanged;
  std::string reason;         ///< reason of kDamaged or kFailed
  AssetDifference geometry;   ///< set if the kind is kChanged
  Both<std::uint64_t> bytes;  ///< sizes of the assets
};
/// The name of a kind. A scan has the first kind of this list whose condition holds:
///  - "damaged": the scan's entry in the reviewed store cannot be read. Or both stores name an
///    asset for the scan, the digests of the two assets differ, and one of the two assets cannot be
///    read.
///  - "failed": the scan failed in the reviewed store, but not in the store to compare with.
///  - "gone": only the store to compare with has the scan.
///  - "changed": both stores have an asset, and the digests of the two assets differ.
///  - "repaired": the reviewed store names an asset for the scan. In the store to compare with, the
///    scan failed, or its entry cannot be read.
///  - "new": the reviewed store names an asset for the scan, and the store to compare with does not
///    have the scan.
const char* name_of(ScanDifference::Kind kind);

struct StoreDiff {
  std::size_t same = 0;  ///< number of scans whose assets are equal, or that failed in both stores
  std::vector<ScanDifference> differences;
};
/// Compares two stores. Only assets whose digests differ are read. The differences are ordered by
/// kind. Within a kind, they are ordered by these numbers, the largest first: slices without a
/// corresponding slice, hausdorff_mm, and the differences of area, triangles and bytes. Equal ones
/// are ordered by name. Errors: kUnwritable if `stop` was set; the comparison then ends early.
Result<StoreDiff> compare_stores(const farm::Store& now, const farm::Store& before,
                                 const std::atomic<bool>* stop = nullptr);

}  // namespace trocar::pipeline
