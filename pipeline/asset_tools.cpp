// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/asset_tools.h"

#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/System/omstream.hh>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <optional>
#include <regex>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>

#include "formats/base/file_io.h"
#include "pipeline/mesh/triangulation.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ObjMesh = OpenMesh::TriMesh_ArrayKernelT<>;

std::string number(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", v);
  return text;
}

// Is p strictly inside the ring, or one of its vertices?
bool inside_or_vertex(const Ring& ring, LatticePoint p) {
  bool in = false;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
    if (p == a) return true;
    if ((a.y > p.y) == (b.y > p.y)) continue;
    if (a.y > b.y) std::swap(a, b);
    if (orient2d(a, b, p) > 0) in = !in;
  }
  return in;
}

// A point strictly inside each hole and outside the islands in it. With every ring in the hole
// reversed, the triangulation covers what is not material; its triangles at the hole's own rim lie
// in this hole and not in a deeper one.
Result<std::vector<std::array<double, 2>>> hole_seeds(const Pslg& pslg, const Lattice& lattice) {
  std::vector<std::array<double, 2>> seeds;
  for (const Ring& hole : pslg.rings) {
    if (doubled_area(hole) > 0) continue;
    Pslg complement;
    for (const Ring& ring : pslg.rings) {
      if (!std::all_of(ring.begin(), ring.end(),
                       [&hole](LatticePoint p) { return inside_or_vertex(hole, p); }))
        continue;
      complement.rings.emplace_back(ring.rbegin(), ring.rend());
    }
    const auto triangulation = triangulate(complement);
    if (!triangulation) return triangulation.error();
    const SliceMesh& mesh = triangulation->mesh;
    std::set<std::pair<LatticePoint, LatticePoint>> rim;
    for (std::size_t i = 0; i < hole.size(); ++i)
      rim.emplace(hole[(i + 1) % hole.size()], hole[i]);
    std::int64_t best = 0;
    std::array<double, 2> seed{};
    for (const Triangle& t : mesh.triangles) {
      const std::array<LatticePoint, 3> p = {mesh.vertices[t[0]], mesh.vertices[t[1]],
                                             mesh.vertices[t[2]]};
      const bool on_rim =
          rim.contains({p[0], p[1]}) || rim.contains({p[1], p[2]}) || rim.contains({p[2], p[0]});
      if (on_rim && orient2d(p[0], p[1], p[2]) > best) {
        best = orient2d(p[0], p[1], p[2]);
        seed = {(lattice.to_mm(p[0].x) + lattice.to_mm(p[1].x) + lattice.to_mm(p[2].x)) / 3,
                (lattice.to_mm(p[0].y) + lattice.to_mm(p[1].y) + lattice.to_mm(p[2].y)) / 3};
      }
    }
    seeds.push_back(seed);
  }
  return seeds;
}

Result<std::string> poly_text(const AssetSlice& slice, const Lattice& lattice) {
  const auto seeds = hole_seeds(slice.pslg, lattice);
  if (!seeds) return seeds.error();
  std::size_t n = 0;
  for (const Ring& ring : slice.pslg.rings)
    n += ring.size();
  std::ostringstream out;
  out << "# slice " << slice.index << ", mm in the slice plane\n" << n << " 2 0 1\n";
  std::size_t at = 0;
  for (const Ring& ring : slice.pslg.rings) {
    for (const LatticePoint p : ring)
      out << ++at << ' ' << number(lattice.to_mm(p.x)) << ' ' << number(lattice.to_mm(p.y))
          << " 1\n";
  }
  out << n << " 1\n";
  std::size_t first = 1, segment = 0;
  for (const Ring& ring : slice.pslg.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      out << ++segment << ' ' << first + i << ' ' << first + (i + 1) % ring.size() << " 1\n";
    first += ring.size();
  }
  out << seeds->size() << '\n';
  for (std::size_t i = 0; i < seeds->size(); ++i)
    out << i + 1 << ' ' << number((*seeds)[i][0]) << ' ' << number((*seeds)[i][1]) << '\n';
  return out.str();
}

constexpr std::array kSurfaceEndings = {".stl", ".ply", ".obj"};

// By OpenMesh, which refuses a mesh that is not manifold: a check independent of ours.
Result<std::string> obj_text(const AssetSlice& slice, const Lattice& lattice) {
  ObjMesh mesh;
  std::vector<ObjMesh::VertexHandle> handles;
  for (const LatticePoint p : slice.mesh.vertices) {
    const Eigen::Vector3d q =
        slice.T_lps_plane * Eigen::Vector3d(lattice.to_mm(p.x), lattice.to_mm(p.y), 0);
    handles.push_back(mesh.add_vertex(ObjMesh::Point(
        static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z()))));
  }
  for (const Triangle& t : slice.mesh.triangles) {
    if (!mesh.add_face(handles[t[0]], handles[t[1]], handles[t[2]]).is_valid()) {
      return refused("slice " + std::to_string(slice.index) + ": OpenMesh finds it not manifold");
    }
  }
  std::ostringstream out;
  if (!OpenMesh::IO::write_mesh(mesh, out, ".obj", OpenMesh::IO::Options::Default, 9))
    return bug("OpenMesh cannot write .obj");
  return out.str();
}

// By OpenMesh too. Coordinates are numbers of steps that a float carries exactly.
Result<std::array<std::string, 3>> surface_texts(const TriangleSurface& surface) {
  ObjMesh mesh;
  mesh.request_vertex_normals();
  mesh.request_face_normals();
  std::vector<ObjMesh::VertexHandle> handles;
  const std::vector<Eigen::Vector3f> normals = vertex_normals(surface);
  for (std::size_t v = 0; v < surface.vertices.size(); ++v) {
    ObjMesh::Point p;
    for (std::size_t k = 0; k < 3; ++k)
      p[k] = static_cast<float>(surface.lattice.to_mm(surface.vertices[v][k]));
    handles.push_back(mesh.add_vertex(p));
    mesh.set_normal(handles.back(), {normals[v].x(), normals[v].y(), normals[v].z()});
  }
  for (const auto& t : surface.triangles) {
    if (!mesh.add_face(handles[t[0]], handles[t[1]], handles[t[2]]).is_valid())
      return refused("the surface: OpenMesh finds it not manifold");
  }
  mesh.update_face_normals();
  using OpenMesh::IO::Options;
  std::array<std::string, 3> out;
  const std::array options{Options(Options::Binary),
                           Options(Options::Binary | Options::VertexNormal),
                           Options(Options::VertexNormal)};
  for (std::size_t k = 0; k < out.size(); ++k) {
    std::ostringstream text;
    if (!OpenMesh::IO::write_mesh(mesh, text, kSurfaceEndings.at(k), options.at(k), 9))
      return bug(std::string("OpenMesh cannot write ") + kSurfaceEndings.at(k));
    out.at(k) = text.str();
  }
  return out;
}

std::string svg_text(const AssetSlice& slice, const Lattice& lattice) {
  LatticePoint low = slice.mesh.vertices[0], high = low;
  for (const LatticePoint p : slice.mesh.vertices) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y)};
  }
  const double x0 = lattice.to_mm(low.x) - 1, y0 = lattice.to_mm(low.y) - 1;
  const double w = lattice.to_mm(high.x) + 1 - x0, h = lattice.to_mm(high.y) + 1 - y0;
  std::ostringstream out;
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"" << x0 << ' ' << y0 << ' ' << w
      << ' ' << h << "\" width=\"" << w << "mm\" height=\"" << h
      << "mm\">\n<path fill=\"#e3d9c2\" stroke=\"#888\" stroke-width=\"0.03\" d=\"";
  for (const Triangle& t : slice.mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const LatticePoint p = slice.mesh.vertices[t[i]];
      out << (i == 0 ? 'M' : 'L') << lattice.to_mm(p.x) << ' ' << lattice.to_mm(p.y);
    }
    out << "Z\n";
  }
  out << "\"/>\n<path fill=\"none\" stroke=\"#a11\" stroke-width=\"0.1\" d=\"";
  for (const Ring& ring : slice.pslg.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      out << (i == 0 ? 'M' : 'L') << lattice.to_mm(ring[i].x) << ' ' << lattice.to_mm(ring[i].y);
    out << "Z\n";
  }
  out << "\"/>\n</svg>\n";
  return out.str();
}

constexpr std::array kEndings = {".poly", ".obj", ".svg"};

// With its material's number, if the asset has several.
std::string slice_name(const Asset& asset, const AssetSlice& slice) {
  char name[32];
  std::snprintf(name, sizeof name, "slice_%04d", slice.index);
  return asset.materials.size() > 1 ? name + ('_' + std::to_string(slice.material)) : name;
}

// In the order of kEndings.
Result<std::array<std::string, 3>> slice_texts(const AssetSlice& slice, const Lattice& lattice) {
  auto poly = poly_text(slice, lattice);
  if (!poly) return poly.error();
  auto obj = obj_text(slice, lattice);
  if (!obj) return obj.error();
  return std::array{std::move(*poly), std::move(*obj), svg_text(slice, lattice)};
}

// Files in the folder with an export's names, of slices that this asset does not have.
std::vector<std::string> other_exports(const Asset& asset, const fs::path& folder) {
  std::set<std::string> ours;
  for (const AssetSlice& slice : asset.slices) {
    if (slice.mesh.triangles.empty()) continue;
    for (const char* ending : kEndings)
      ours.insert(slice_name(asset, slice) + ending);
  }
  static const std::regex exported(R"(slice_\d{4,}(_\d+)?\.(poly|obj|svg))");
  std::vector<std::string> out;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    if (std::regex_match(name, exported) && !ours.contains(name)) out.push_back(name);
  }
  std::sort(out.begin(), out.end());
  return out;
}

// A hidden folder inside the target folder, so that moving files out of it is a rename. The
// destructor removes it with what is left in it, and the target too if make() created it and it is
// still empty.
class ScratchFolder {
 public:
  static Result<std::unique_ptr<ScratchFolder>> make(const fs::path& target) {
    std::error_code error;
    const bool is_new = fs::create_directories(target, error);
    if (error) return unwritable(target.string() + ": " + error.message());
    std::string path = (target / ".trocar-export.XXXXXX").string();
    if (::mkdtemp(path.data()) == nullptr)
      return unwritable(target.string() + ": " + std::generic_category().message(errno));
    return std::make_unique<ScratchFolder>(target, path, is_new);
  }
  ScratchFolder(fs::path target, fs::path path, bool is_new)
      : target_(std::move(target)), path_(std::move(path)), is_new_(is_new) {}
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  ~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
    if (is_new_) fs::remove(target_, ignored);  // only if it is empty
  }

  const fs::path& path() const { return path_; }
  Result<void> move_out(const std::vector<std::string>& names) {
    std::error_code error;
    for (const std::string& name : names) {
      fs::rename(path_ / name, target_ / name, error);
      if (error) return unwritable((target_ / name).string() + ": " + error.message());
    }
    is_new_ = false;
    return {};
  }

 private:
  fs::path target_, path_;
  bool is_new_;
};

}  // namespace

namespace {

using Box = std::array<std::array<double, 2>, 2>;  // lowest and highest corner

/// Of the mesh, in the slice plane, mm; none without material.
std::optional<Box> box_of(const SliceMesh& mesh, double step_mm) {
  if (mesh.vertices.empty()) return std::nullopt;
  constexpr double kFar = std::numeric_limits<double>::infinity();
  Box box{{{kFar, kFar}, {-kFar, -kFar}}};
  for (const LatticePoint p : mesh.vertices) {
    const std::array<double, 2> at{p.x * step_mm, p.y * step_mm};
    for (std::size_t k = 0; k < 2; ++k) {
      box[0][k] = std::min(box[0][k], at[k]);
      box[1][k] = std::max(box[1][k], at[k]);
    }
  }
  return box;
}

/// Centre of the material's area, likewise.
std::optional<std::array<double, 2>> centroid_of(const SliceMesh& mesh, double step_mm) {
  double area = 0;
  std::array<double, 2> sum{};
  for (const Triangle& triangle : mesh.triangles) {
    std::array<std::array<double, 2>, 3> p;
    for (std::size_t k = 0; k < 3; ++k) {
      const LatticePoint corner = mesh.vertices[triangle[k]];
      p[k] = {static_cast<double>(corner.x), static_cast<double>(corner.y)};
    }
    const double each =
        (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
    area += each;
    for (std::size_t k = 0; k < 2; ++k)
      sum[k] += each * (p[0][k] + p[1][k] + p[2][k]) / 3;
  }
  if (!(area > 0)) return std::nullopt;
  return std::array<double, 2>{sum[0] / area * step_mm, sum[1] / area * step_mm};
}

template <typename T>
json or_null(const std::optional<T>& value) {
  return value ? json(*value) : json(nullptr);
}

}  // namespace

json describe_asset(const Asset& asset, std::uint64_t bytes) {
  json slices = json::array();
  std::optional<Box> all;
  std::size_t triangles = 0;
  const double step2 = asset.lattice.step_mm() * asset.lattice.step_mm();
  std::vector<double> areas_mm2(asset.materials.size());
  for (const AssetSlice& s : asset.slices) {
    const double area_mm2 = 0.5 * static_cast<double>(doubled_area(s.mesh)) * step2;
    areas_mm2[static_cast<std::size_t>(s.material)] += area_mm2;
    std::size_t outline = 0;
    for (const Ring& ring : s.pslg.rings)
      outline += ring.size();
    triangles += s.mesh.triangles.size();
    const std::optional<Box> box = box_of(s.mesh, asset.lattice.step_mm());
    if (box && !all) all = box;
    for (std::size_t k = 0; box && k < 2; ++k) {
      (*all)[0][k] = std::min((*all)[0][k], (*box)[0][k]);
      (*all)[1][k] = std::max((*all)[1][k], (*box)[1][k]);
    }
    slices.push_back(
        {{"index", s.index},
         {"material", s.material},
         {"z_mm", s.z_mm},
         {"vertices", s.mesh.vertices.size()},
         {"triangles", s.mesh.triangles.size()},
         {"rings", s.pslg.rings.size()},
         {"outline_segments", outline},
         {"area_mm2", area_mm2},
         {"box_mm", or_null(box)},
         {"centroid_mm", or_null(centroid_of(s.mesh, asset.lattice.step_mm()))},
         {"mean_hu", s.mesh.triangles.empty() ? json(nullptr) : or_null(mean_hu_of(s))},
         {"measures", json::parse(s.measures_json)}});
  }
  json surfaces = json::array();
  for (const AssetSurface& one : asset.surfaces) {
    const Lattice& lattice = one.surface.lattice;
    surfaces.push_back(
        {{"material", one.material},
         {"triangles", one.surface.triangles.size()},
         {"vertices", one.surface.vertices.size()},
         {"lattice_step_mm", lattice.step_mm()},
         {"distance_p99_mm", one.distance_mm},
         {"volume_mm3", enclosed_volume(one.surface) * std::pow(lattice.step_mm(), 3)}});
  }
  json materials = json::array();
  for (std::size_t m = 0; m < asset.materials.size(); ++m) {
    const AssetMaterial& material = asset.materials[m];
    materials.push_back({{"name", material.name},
                         {"label", material.label ? json(*material.label) : json()},
                         {"area_mm2", areas_mm2[m]}});
  }
  json out = {{"generator", asset.generator},
              {"schema", asset.schema},
              {"lattice_bits", asset.lattice.bits},
              {"lattice_step_mm", asset.lattice.step_mm()},
              {"materials", std::move(materials)},
              {"parameters", json::parse(asset.parameters_json)},
              {"bytes", bytes},
              {"triangles", triangles},
              {"box_mm", or_null(all)},
              {"surfaces", std::move(surfaces)},
              {"slices", std::move(slices)}};
  // Of schema 1, and of schema 2 with --input-key.
  if (!asset.input_digest.empty()) out["input_digest"] = asset.input_digest;
  if (!asset.input_key_digest.empty()) out["input_key_digest"] = asset.input_key_digest;
  return out;
}

Result<std::vector<std::string>> export_asset(const Asset& asset, const fs::path& folder,
                                              const std::atomic<bool>* stop) {
  omlog().disable();  // OpenMesh logs every file that it writes
  std::vector<std::string> others = other_exports(asset, folder);
  const auto scratch = ScratchFolder::make(folder);
  if (!scratch) return scratch.error();
  std::vector<std::string> names;
  for (const AssetSlice& slice : asset.slices) {
    if (stop != nullptr && stop->load()) return unwritable("interrupted; nothing was written");
    if (slice.mesh.triangles.empty()) continue;
    const auto texts = slice_texts(slice, asset.lattice);
    if (!texts) return texts.error();
    for (std::size_t k = 0; k < kEndings.size(); ++k) {
      names.push_back(slice_name(asset, slice) + kEndings[k]);
      if (auto ok = write_file_atomically((*scratch)->path() / names.back(), (*texts)[k]); !ok)
        return ok.error();
    }
  }
  if (auto moved = (*scratch)->move_out(names); !moved) return moved.error();
  return others;
}

Result<void> export_surfaces(const Asset& asset, const fs::path& folder,
                             const std::atomic<bool>* stop) {
  omlog().disable();
  if (asset.surfaces.empty())
    return refused("no surface in this asset; trocar-mesh SCAN --surface makes one");
  const auto scratch = ScratchFolder::make(folder);
  if (!scratch) return scratch.error();
  std::vector<std::string> names;
  for (const AssetSurface& one : asset.surfaces) {
    const auto texts = surface_texts(one.surface);
    if (!texts) return texts.error();
    for (std::size_t k = 0; k < kSurfaceEndings.size(); ++k) {
      if (stop != nullptr && stop->load()) return unwritable("interrupted; nothing was written");
      names.emplace_back("surface");
      if (asset.surfaces.size() > 1) names.back().append("_").append(std::to_string(one.material));
      names.back() += kSurfaceEndings.at(k);
      if (auto ok = write_file_atomically((*scratch)->path() / names.back(), texts->at(k)); !ok)
        return ok;
    }
  }
  return (*scratch)->move_out(names);
}

}  // namespace trocar::pipeline
