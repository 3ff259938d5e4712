// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/asset_export.h"

#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/System/omstream.hh>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>

#include "formats/base/file_io.h"
#include "formats/base/system_message.h"
#include "formats/base/text_pattern.h"
#include "pipeline/program/triangle_poly.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using ObjMesh = OpenMesh::TriMesh_ArrayKernelT<>;

constexpr std::array kSurfaceEndings = {".stl", ".ply", ".obj"};

// OpenMesh writes the file. It refuses a mesh that is not manifold, which is an independent check.
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

// The file name of a slice, with its material's number if the asset has several materials.
std::string slice_name(const Asset& asset, const AssetSlice& slice) {
  char name[32];
  std::snprintf(name, sizeof name, "slice_%04d", slice.index);
  return asset.materials.size() > 1 ? name + ('_' + std::to_string(slice.material)) : name;
}

// The files of a slice in the order of kEndings.
Result<std::array<std::string, 3>> slice_texts(const AssetSlice& slice, const Lattice& lattice) {
  auto poly = poly_text(slice, lattice);
  if (!poly) return poly.error();
  auto obj = obj_text(slice, lattice);
  if (!obj) return obj.error();
  return std::array{std::move(*poly), std::move(*obj), svg_text(slice, lattice)};
}

// The files that an export of other slices has left in the folder.
std::vector<std::string> other_exports(const Asset& asset, const fs::path& folder) {
  std::set<std::string> ours;
  for (const AssetSlice& slice : asset.slices) {
    if (slice.mesh.triangles.empty()) continue;
    for (const char* ending : kEndings)
      ours.insert(slice_name(asset, slice) + ending);
  }
  const char* const exported = R"(slice_[0-9]{4,}(_[0-9]+)?\.(poly|obj|svg))";
  std::vector<std::string> out;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    if (matches(name, exported) && !ours.contains(name)) out.push_back(name);
  }
  std::sort(out.begin(), out.end());
  return out;
}

// A hidden folder inside the target folder, so that moving files out of it is a rename. The
// destructor removes it with its remaining files, and also the target if make() created it and it
// is still empty.
class ScratchFolder {
 public:
  static Result<std::unique_ptr<ScratchFolder>> make(const fs::path& target) {
    std::error_code error;
    const bool is_new = fs::create_directories(target, error);
    if (error) return unwritable(target.string() + ": " + error.message());
    std::string path = (target / ".trocar-export.XXXXXX").string();
    if (::mkdtemp(path.data()) == nullptr)
      return unwritable(target.string() + ": " + system_message(errno));
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

  // Moves these files into the target folder. A folder in the place of a file is found before any
  // file is moved.
  Result<void> move_out(const std::vector<std::string>& names) {
    std::error_code error;
    for (const std::string& name : names) {
      if (fs::is_directory(fs::symlink_status(target_ / name, error)))
        return unwritable((target_ / name).string() + ": " + system_message(EISDIR));
    }
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

bool is_surface_ending(std::string_view ending) {
  return std::find(kSurfaceEndings.begin(), kSurfaceEndings.end(), ending) != kSurfaceEndings.end();
}

Result<std::string> surface_text(const TriangleSurface& surface, const std::string& ending) {
  omlog().disable();  // OpenMesh logs every file that it writes
  ObjMesh mesh;
  mesh.request_vertex_normals();
  mesh.request_face_normals();
  std::vector<ObjMesh::VertexHandle> handles;
  const std::vector<Eigen::Vector3f> normals = vertex_normals(surface);
  for (std::size_t v = 0; v < surface.vertices.size(); ++v) {
    ObjMesh::Point p;
    for (std::size_t k = 0; k < 3; ++k)  // a float represents lattice coordinates exactly
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
  Options options(ending == ".obj" ? Options::Default : Options::Binary);
  if (ending != ".stl") options += Options::VertexNormal;
  std::ostringstream text;
  if (!OpenMesh::IO::write_mesh(mesh, text, ending, options, 9))
    return bug("OpenMesh cannot write " + ending);
  return text.str();
}

Result<void> export_surfaces(const Asset& asset, const fs::path& folder,
                             const std::atomic<bool>* stop) {
  if (asset.surfaces.empty())
    return refused("no surface in this asset; trocar-mesh SCAN --surface makes one");
  const auto scratch = ScratchFolder::make(folder);
  if (!scratch) return scratch.error();
  std::vector<std::string> names;
  for (const AssetSurface& one : asset.surfaces) {
    for (const char* ending : kSurfaceEndings) {
      if (stop != nullptr && stop->load()) return unwritable("interrupted; nothing was written");
      names.emplace_back("surface");
      if (asset.surfaces.size() > 1) names.back().append("_").append(std::to_string(one.material));
      names.back() += ending;
      const auto text = surface_text(one.surface, ending);
      if (!text) return text.error();
      if (auto ok = write_file_atomically((*scratch)->path() / names.back(), *text); !ok) return ok;
    }
  }
  return (*scratch)->move_out(names);
}

}  // namespace trocar::pipeline
