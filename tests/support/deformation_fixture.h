// SPDX-License-Identifier: Apache-2.0
// Sheets and tools for the tests of runtime/haptics/membrane, and the assets of the three scans where
// they are available.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "runtime/haptics/membrane/network.h"
#include "tests/support/uniform.h"

namespace trocar::test {

/// A membrane whose decay length is 8 mm.
inline const runtime::Membrane kMembrane{320, 5e6};

/// The corners of a regular polygon, counter-clockwise.
inline Ring regular_polygon(LatticePoint centre, double circumradius, int sides, double turn = 0) {
  Ring out;
  for (int k = 0; k < sides; ++k) {
    const double angle = turn + 2 * std::numbers::pi * k / sides;
    out.push_back(
        {centre.x + static_cast<std::int32_t>(std::lrint(circumradius * std::cos(angle))),
         centre.y + static_cast<std::int32_t>(std::lrint(circumradius * std::sin(angle)))});
  }
  return out;
}

/// The sheet around a round tool, as a polar grid: `sides` along the tool, `rings` of triangles
/// whose circles grow geometrically from `inner` to `outer` steps. The first `sides` vertices are
/// the tool's, the last the rim's.
inline SliceMesh polar_mesh(double inner, double outer, int sides, int rings) {
  SliceMesh mesh;
  for (int r = 0; r <= rings; ++r) {
    const double radius = inner * std::pow(outer / inner, static_cast<double>(r) / rings);
    for (const LatticePoint p :
         regular_polygon({}, radius, sides, (r % 2) * std::numbers::pi / sides))
      mesh.vertices.push_back(p);
  }
  const auto at = [&](int r, int k) { return static_cast<std::uint32_t>(r * sides + k % sides); };
  for (int r = 0; r < rings; ++r) {
    for (int k = 0; k < sides; ++k) {
      // Every other circle is turned by half a side.
      if (r % 2 == 0) {
        mesh.triangles.push_back({at(r, k), at(r + 1, k), at(r, k + 1)});
        mesh.triangles.push_back({at(r, k + 1), at(r + 1, k), at(r + 1, k + 1)});
      } else {
        mesh.triangles.push_back({at(r, k), at(r + 1, k), at(r + 1, k + 1)});
        mesh.triangles.push_back({at(r, k), at(r + 1, k + 1), at(r, k + 1)});
      }
    }
  }
  return mesh;
}

/// `cells` x `cells` points in rows, every other shifted by half: triangles near to equilateral.
inline SliceMesh triangular_mesh(LatticePoint origin, std::int32_t cell, int cells) {
  SliceMesh mesh;
  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) {
      mesh.vertices.push_back({origin.x + i * cell + (j % 2) * cell / 2,
                               origin.y + static_cast<std::int32_t>(j * cell * 0.866)});
    }
  }
  const auto at = [&](int i, int j) { return static_cast<std::uint32_t>(j * cells + i); };
  for (int j = 0; j + 1 < cells; ++j) {
    for (int i = 0; i + 1 < cells; ++i) {
      const std::uint32_t a = at(i, j), b = at(i + 1, j), c = at(i, j + 1), d = at(i + 1, j + 1);
      if (j % 2 == 0) {
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({b, d, c});
      } else {
        mesh.triangles.push_back({a, b, d});
        mesh.triangles.push_back({a, d, c});
      }
    }
  }
  return mesh;
}

/// An asset of the folder TROCAR_ASSETS.
struct ScanAsset {
  std::string name;
  Asset asset;
  std::vector<const AssetSlice*> slices;  ///< those with material
};

/// sample, l3 and head, as far as they are available.
inline std::vector<ScanAsset> scan_assets(const std::string& suffix = "") {
  std::vector<ScanAsset> out;
  const char* folder = std::getenv("TROCAR_ASSETS");  // NOLINT(concurrency-mt-unsafe)
  if (folder == nullptr) return out;
  for (const char* name : {"sample", "l3", "head"}) {
    const std::filesystem::path file = std::filesystem::path(folder) / (name + suffix + ".glb");
    if (!std::filesystem::exists(file)) continue;
    Result<Asset> asset = read_asset(file);
    if (!asset) continue;
    out.push_back({name, std::move(*asset), {}});
  }
  for (ScanAsset& scan : out) {
    for (const AssetSlice& slice : scan.asset.slices) {
      if (!slice.mesh.triangles.empty()) scan.slices.push_back(&slice);
    }
  }
  return out;
}

/// A place over material: in a random triangle of the slice, so that thin parts and places near
/// boundaries and holes are frequent.
inline LatticePoint place_in(const SliceMesh& mesh, std::mt19937_64& random) {
  const Triangle& t = mesh.triangles[random() % mesh.triangles.size()];
  double a = uniform(random), b = uniform(random);
  if (a + b > 1) {
    a = 1 - a;
    b = 1 - b;
  }
  const LatticePoint p = mesh.vertices[t[0]], q = mesh.vertices[t[1]], r = mesh.vertices[t[2]];
  return {p.x + static_cast<std::int32_t>(a * (q.x - p.x) + b * (r.x - p.x)),
          p.y + static_cast<std::int32_t>(a * (q.y - p.y) + b * (r.y - p.y))};
}

}  // namespace trocar::test
