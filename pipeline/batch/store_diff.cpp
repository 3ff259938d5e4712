// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/store_diff.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "pipeline/contour/outline_distance.h"
#include "pipeline/read/parallel_for.h"

namespace trocar::pipeline {
namespace {

using farm::IndexedScan;
using farm::Object;
using farm::Store;
using Status = IndexedScan::Status;
using DifferenceKind = ScanDifference::Kind;
using SliceKey = std::pair<int, int>;  // slice, material

std::map<SliceKey, const AssetSlice*> slices_with_material(const Asset& asset) {
  std::map<SliceKey, const AssetSlice*> out;
  for (const AssetSlice& s : asset.slices) {
    if (!s.pslg.rings.empty()) out[{s.index, s.material}] = &s;
  }
  return out;
}

double area_mm2(const Asset& asset) {
  double steps2 = 0;
  for (const AssetSlice& s : asset.slices)
    steps2 += static_cast<double>(doubled_area(s.mesh)) / 2;
  return steps2 * asset.lattice.step_mm() * asset.lattice.step_mm();
}

// The rings in mm in the plane to which `T` maps, and their largest distance from this plane.
std::pair<std::vector<OutlineRing>, double> rings_in(const Eigen::Affine3d& T,
                                                     const AssetSlice& slice,
                                                     const Lattice& lattice) {
  std::pair<std::vector<OutlineRing>, double> out;
  for (const Ring& ring : slice.pslg.rings) {
    OutlineRing placed;
    for (const LatticePoint p : ring) {
      const Eigen::Vector3d q = T * Eigen::Vector3d(lattice.to_mm(p.x), lattice.to_mm(p.y), 0);
      placed.push_back({q.x(), q.y()});
      out.second = std::max(out.second, std::abs(q.z()));
    }
    out.first.push_back(std::move(placed));
  }
  return out;
}

double distance_mm(const AssetSlice& now, const Lattice& lattice_now, const AssetSlice& before,
                   const Lattice& lattice_before) {
  // If the planes are equal, nothing is transformed, because rounding would move the outline.
  const bool is_same_plane = now.T_lps_plane.matrix() == before.T_lps_plane.matrix();
  const Eigen::Affine3d T_now_before =
      is_same_plane ? Eigen::Affine3d::Identity()
                    : Eigen::Affine3d(now.T_lps_plane.inverse() * before.T_lps_plane);
  const auto a = rings_in(Eigen::Affine3d::Identity(), now, lattice_now);
  const auto b = rings_in(T_now_before, before, lattice_before);
  return std::max(b.second, outline_distance_mm(a.first, b.first));
}

double magnitude(const Both<double>& of) {
  return std::abs(of.now - of.before);
}
std::uint64_t magnitude(const Both<std::uint64_t>& of) {
  return of.now > of.before ? of.now - of.before : of.before - of.now;
}

bool is_worse(const ScanDifference& a, const ScanDifference& b) {
  const auto rank = [](const ScanDifference& d) {
    const AssetDifference& g = d.geometry;
    return std::tuple(static_cast<int>(d.kind), -(g.slices_alone.now + g.slices_alone.before),
                      -g.hausdorff_mm, -magnitude(g.area_mm2));
  };
  const auto ra = rank(a), rb = rank(b);
  if (ra != rb) return ra < rb;
  const auto ta = magnitude(a.geometry.triangles), tb = magnitude(b.geometry.triangles);
  if (ta != tb) return ta > tb;
  if (magnitude(a.bytes) != magnitude(b.bytes)) return magnitude(a.bytes) > magnitude(b.bytes);
  return a.name < b.name;
}

// Sets the difference that follows from two entries without reading their assets. Returns false if
// there is none.
bool differ(const IndexedScan& now, const IndexedScan& before, ScanDifference& out) {
  out.bytes = {now.asset.bytes, before.asset.bytes};
  if (now.status == Status::kDamaged) {
    out.kind = DifferenceKind::kDamaged, out.reason = now.reason;
  } else if (now.status == Status::kFailed) {
    if (before.status == Status::kFailed) return false;
    out.kind = DifferenceKind::kFailed, out.reason = now.reason;
  } else if (before.status != Status::kDone) {
    out.kind = DifferenceKind::kRepaired;
  } else {
    return now.asset.sha256 != before.asset.sha256;
  }
  return true;
}

AssetDifference compare_assets(const Asset& now, const Asset& before) {
  AssetDifference out;
  out.area_mm2 = {area_mm2(now), area_mm2(before)};
  out.triangles = {triangles_of(now), triangles_of(before)};
  const auto a = slices_with_material(now), b = slices_with_material(before);
  for (const auto& [key, slice] : a) {
    const auto other = b.find(key);
    if (other == b.end()) {
      ++out.slices_alone.now;
      continue;
    }
    const double d = distance_mm(*slice, now.lattice, *other->second, before.lattice);
    if (d > 0 || slice->mesh.triangles.size() != other->second->mesh.triangles.size())
      ++out.slices_changed;
    if (out.worst_slice < 0 || d > out.hausdorff_mm)
      out.hausdorff_mm = d, out.worst_slice = key.first;
  }
  for (const auto& [key, slice] : b)
    out.slices_alone.before += a.contains(key) ? 0 : 1;
  return out;
}

struct Pair {
  std::size_t index = 0;  // index in the differences
  Object now, before;
};

void compare_pair(const Store& now, const Store& before, const Pair& pair, ScanDifference& out) {
  const auto a = farm::read_stored_asset(now, pair.now);
  const auto b = a ? farm::read_stored_asset(before, pair.before) : a;
  if (!a || !b) {
    out.kind = DifferenceKind::kDamaged;
    out.reason = (a ? b : a).error().message;
    return;
  }
  out.geometry = compare_assets(*a, *b);
}

}  // namespace

std::uint64_t triangles_of(const Asset& asset) {
  std::uint64_t out = 0;
  for (const AssetSlice& s : asset.slices)
    out += s.mesh.triangles.size();
  return out;
}

const char* name_of(DifferenceKind kind) {
  constexpr std::array kNames = {"damaged", "failed", "gone", "changed", "repaired", "new"};
  return kNames.at(static_cast<std::size_t>(kind));
}

Result<StoreDiff> compare_stores(const Store& now, const Store& before,
                                 const std::atomic<bool>* stop) {
  const auto scans_now = farm::indexed_scans(now);
  if (!scans_now) return scans_now.error();
  const auto scans_before = farm::indexed_scans(before);
  if (!scans_before) return scans_before.error();
  StoreDiff out;
  std::vector<Pair> pairs;
  std::map<std::string, const IndexedScan*> others;
  for (const IndexedScan& scan : *scans_before)
    others[scan.name] = &scan;
  for (const IndexedScan& scan : *scans_now) {
    ScanDifference one{scan.name, DifferenceKind::kChanged, {}, {}, {}};
    const auto other = others.find(scan.name);
    if (other == others.end()) {
      one.kind = scan.status == Status::kDone     ? DifferenceKind::kNew
                 : scan.status == Status::kFailed ? DifferenceKind::kFailed
                                                  : DifferenceKind::kDamaged;
      one.reason = scan.reason;
      one.bytes.now = scan.asset.bytes;
    } else if (differ(scan, *other->second, one)) {
      if (one.kind == DifferenceKind::kChanged)
        pairs.push_back({out.differences.size(), scan.asset, other->second->asset});
    } else {
      ++out.same;
      others.erase(other);
      continue;
    }
    if (other != others.end()) others.erase(other);
    out.differences.push_back(std::move(one));
  }
  for (const auto& [name, scan] : others)
    out.differences.push_back({name, DifferenceKind::kGone, {}, {}, {0, scan->asset.bytes}});

  parallel_for(static_cast<int>(pairs.size()), [&](int i) {
    if (stop != nullptr && *stop) return;
    const Pair& pair = pairs[static_cast<std::size_t>(i)];
    compare_pair(now, before, pair, out.differences[pair.index]);
  });
  if (stop != nullptr && *stop) return unwritable("interrupted");
  std::sort(out.differences.begin(), out.differences.end(), is_worse);
  return out;
}

}  // namespace trocar::pipeline
