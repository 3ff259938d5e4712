// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/surface/cgal_verification.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>

#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/triangulation.h"

namespace trocar::pipeline {
namespace {

Ring box(std::int32_t low, std::int32_t high, bool hole) {
  Ring out{{low, low}, {high, low}, {high, high}, {low, high}};
  if (hole) std::reverse(out.begin(), out.end());
  return out;
}

AssetSlice meshed_slice(const Pslg& outline) {
  const Lattice lattice;
  RefinementOptions options;
  options.max_area_mm2 = 4;
  const auto cdt = triangulate(outline);
  EXPECT_TRUE(cdt);
  AssetSlice out;
  out.index = 3;
  out.mesh = refine(*cdt, lattice, options).mesh;
  out.pslg = boundary_rings(out.mesh);
  return out;
}

// A plate with a hole in which an island lies, refined.
AssetSlice good_slice() {
  Ring island = box(-300, 500, false);
  island[2] = {700, 600};
  return meshed_slice({{box(-4000, 4000, false), box(-1500, 1500, true), island}});
}

Result<void> confirmed(AssetSlice slice) {
  Asset asset;
  asset.slices.push_back(std::move(slice));
  return confirm_by_cgal(asset, "damaged.glb");
}

bool on_outline(const AssetSlice& slice, LatticePoint p) {
  return std::any_of(slice.pslg.rings.begin(), slice.pslg.rings.end(), [&](const Ring& ring) {
    return std::find(ring.begin(), ring.end(), p) != ring.end();
  });
}

LatticePoint& inner_vertex(AssetSlice& slice) {
  for (LatticePoint& p : slice.mesh.vertices)
    if (!on_outline(slice, p)) return p;
  ADD_FAILURE() << "no inner vertex";
  return slice.mesh.vertices[0];
}

// Flips the first inner edge for which the flipped pair of triangles is valid and not Delaunay.
void flip_an_edge(AssetSlice& slice) {
  SliceMesh& mesh = slice.mesh;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::size_t> owner;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      owner[{mesh.triangles[i][k], mesh.triangles[i][(k + 1) % 3]}] = i;
  for (const auto& [edge, i] : owner) {
    const auto other = owner.find({edge.second, edge.first});
    if (other == owner.end()) continue;
    const auto far = [&edge = edge](const Triangle& t) {
      for (const std::uint32_t v : t)
        if (v != edge.first && v != edge.second) return v;
      return t[0];
    };
    const std::uint32_t c = far(mesh.triangles[i]), d = far(mesh.triangles[other->second]);
    const auto& p = mesh.vertices;
    if (orient2d(p[edge.first], p[d], p[c]) <= 0 || orient2d(p[d], p[edge.second], p[c]) <= 0)
      continue;
    if (in_circle(p[edge.first], p[edge.second], p[c], p[d]) == 0) continue;
    mesh.triangles[i] = {edge.first, d, c};
    mesh.triangles[other->second] = {d, edge.second, c};
    return;
  }
  ADD_FAILURE() << "no edge to flip";
}

// An inner vertex is cut in two: the triangles on one side of it use a copy at the same place.
void open_a_seam(AssetSlice& slice) {
  SliceMesh& mesh = slice.mesh;
  const auto v = static_cast<std::uint32_t>(&inner_vertex(slice) - mesh.vertices.data());
  const auto copy = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.push_back(mesh.vertices[v]);
  for (Triangle& t : mesh.triangles) {
    for (std::uint32_t& corner : t) {
      if (corner != v) continue;
      corner = copy;
      return;
    }
  }
}

// This is the result of a mesher that ignores the hole.
void mesh_the_hole(AssetSlice& slice) {
  slice.mesh = meshed_slice({{box(-4000, 4000, false)}}).mesh;
}

struct Damage {
  const char* name;
  std::function<void(AssetSlice&)> plant;
};

const std::vector<Damage>& damages() {
  static const std::vector<Damage> all{
      {"inner vertex far away",
       [](AssetSlice& s) {
         inner_vertex(s) = {3999, -3999};
       }},
      {"two vertices swapped",
       [](AssetSlice& s) { std::swap(s.mesh.vertices[0], s.mesh.vertices[1]); }},
      {"outline vertex of the mesh moved",
       [](AssetSlice& s) {
         const LatticePoint at = s.pslg.rings[0][0];
         *std::find(s.mesh.vertices.begin(), s.mesh.vertices.end(), at) = {at.x - 1, at.y};
       }},
      {"triangle missing", [](AssetSlice& s) { s.mesh.triangles.pop_back(); }},
      {"triangle twice", [](AssetSlice& s) { s.mesh.triangles.push_back(s.mesh.triangles[0]); }},
      {"triangle clockwise",
       [](AssetSlice& s) { std::swap(s.mesh.triangles[0][0], s.mesh.triangles[0][1]); }},
      {"corner of another triangle",
       [](AssetSlice& s) { s.mesh.triangles[0][0] = s.mesh.triangles.back()[0]; }},
      {"corner that is not there",
       [](AssetSlice& s) {
         s.mesh.triangles[0][0] = static_cast<std::uint32_t>(s.mesh.vertices.size());
       }},
      {"edge flipped, no longer Delaunay", flip_an_edge},
      {"vertex in no triangle",
       [](AssetSlice& s) {
         s.mesh.vertices.push_back({17, 3000});
       }},
      {"seam: a vertex twice at one place", open_a_seam},
      {"hole covered by triangles", mesh_the_hole},
      {"no triangles at all", [](AssetSlice& s) { s.mesh.triangles.clear(); }},
      {"outline empty", [](AssetSlice& s) { s.pslg.rings.clear(); }},
      {"ring missing", [](AssetSlice& s) { s.pslg.rings.pop_back(); }},
      {"ring twice", [](AssetSlice& s) { s.pslg.rings.push_back(s.pslg.rings[0]); }},
      {"ring the other way round",
       [](AssetSlice& s) { std::reverse(s.pslg.rings[1].begin(), s.pslg.rings[1].end()); }},
      {"all rings the other way round",
       [](AssetSlice& s) {
         for (Ring& ring : s.pslg.rings)
           std::reverse(ring.begin(), ring.end());
       }},
      {"point of a ring missing",
       [](AssetSlice& s) { s.pslg.rings[0].erase(s.pslg.rings[0].begin() + 1); }},
      {"two points of a ring swapped",
       [](AssetSlice& s) { std::swap(s.pslg.rings[0][1], s.pslg.rings[0][2]); }},
      {"ring that crosses another",
       [](AssetSlice& s) {
         s.pslg.rings.push_back({{-4500, 0}, {0, 100}, {-4500, 200}});
       }},
      {"point beside the mesh's vertices",
       [](AssetSlice& s) {
         s.pslg.rings[0].insert(s.pslg.rings[0].begin() + 1, {-3999, -4100});
       }},
      {"ring of two points",
       [](AssetSlice& s) {
         s.pslg.rings.push_back({{0, 0}, {10, 10}});
       }},
      {"ring that runs along itself",
       [](AssetSlice& s) {
         Ring& ring = s.pslg.rings[0];
         ring.insert(ring.begin() + 1, {ring[1], ring[0]});
       }},
  };
  return all;
}

TEST(SecondOpinion, ConfirmsWhatTheMesherMakes) {
  EXPECT_TRUE(confirmed(good_slice())) << confirmed(good_slice()).error().message;
  EXPECT_TRUE(confirmed({}));  // a slice without material
}

// Unrefined squares have four cocircular corners: two valid triangulations.
TEST(SecondOpinion, TakesEveryTriangulationOfCocircularPoints) {
  AssetSlice slice;
  slice.pslg.rings = {box(0, 100, false)};
  slice.mesh.vertices = slice.pslg.rings[0];
  slice.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  EXPECT_TRUE(confirmed(slice));
  slice.mesh.triangles = {{0, 1, 3}, {1, 2, 3}};
  EXPECT_TRUE(confirmed(slice));
}

TEST(SecondOpinion, FindsEachKindOfDamage) {
  ASSERT_GE(damages().size(), 20U);
  for (const Damage& damage : damages()) {
    AssetSlice slice = good_slice();
    damage.plant(slice);
    const auto ok = confirmed(slice);
    ASSERT_FALSE(ok) << damage.name;
    EXPECT_EQ(ok.error().code, ExitCode::kRefused);
    EXPECT_TRUE(ok.error().message.starts_with("damaged.glb, slice 3: ")) << ok.error().message;
    EXPECT_EQ(ok.error().message.find('\n'), std::string::npos);
  }
}

TEST(SecondOpinion, FindsASurfaceThatIntersectsItself) {
  // Two tetrahedra, first apart, then one with a corner in the other.
  for (const std::int32_t shift : {100, 3}) {
    AssetSurface one;
    for (const std::int32_t by : {0, shift}) {
      const auto first = static_cast<std::uint32_t>(one.surface.vertices.size());
      one.surface.vertices.insert(
          one.surface.vertices.end(),
          {{by, by, by}, {10 + by, by, by}, {by, 10 + by, by}, {by, by, 10 + by}});
      one.surface.triangles.insert(one.surface.triangles.end(), {{first, first + 2, first + 1},
                                                                 {first, first + 1, first + 3},
                                                                 {first + 1, first + 2, first + 3},
                                                                 {first, first + 3, first + 2}});
    }
    Asset asset;
    asset.surfaces = {one};
    ASSERT_TRUE(verify_asset(asset, "a.glb"));
    const auto ok = confirm_by_cgal(asset, "a.glb");
    EXPECT_EQ(static_cast<bool>(ok), shift == 100);
    if (ok) continue;
    EXPECT_EQ(ok.error().code, ExitCode::kRefused);
    EXPECT_TRUE(ok.error().message.starts_with("a.glb, surface of material 0: "))
        << ok.error().message;
  }
}

}  // namespace
}  // namespace trocar::pipeline
