// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/commands.h"

#include <Eigen/Geometry>
#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/System/omstream.hh>
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <optional>
#include <set>
#include <sstream>
#include <system_error>

#include "formats/asset/deidentification.h"
#include "formats/base/command_line.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/read/number_ranges.h"
#include "pipeline/surface/cgal_verification.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using ObjMesh = OpenMesh::TriMesh_ArrayKernelT<>;
using nlohmann::json;

struct InfoArguments {
  std::filesystem::path asset;
  bool as_json = false;
};

struct VerifyArguments {
  std::vector<std::filesystem::path> assets;
  bool as_json = false;
  bool with_cgal = false;  // also verifies every slice with CGAL
  // Also refuses texts that may identify the patient, and HU around the material (--context).
  bool deidentified = false;
};

struct ExportArguments {
  std::filesystem::path asset, folder;
  bool surface = false;  // writes the surfaces instead of the slices
};

/// Bounding box of the mesh in the slice plane, mm; it is empty for an empty mesh.
Eigen::AlignedBox2d box_of(const SliceMesh& mesh, double step_mm) {
  Eigen::AlignedBox2d box;
  for (const LatticePoint p : mesh.vertices)
    box.extend(Eigen::Vector2d(p.x * step_mm, p.y * step_mm));
  return box;
}

/// The lowest and the highest corner of a box; null for an empty box.
json corners_json(const Eigen::AlignedBox2d& box) {
  if (box.isEmpty()) return nullptr;
  return {{box.min().x(), box.min().y()}, {box.max().x(), box.max().y()}};
}

/// Centroid of the material in the slice plane, mm; std::nullopt for an empty mesh.
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

// The JSON that `info` prints (formats/session/info.schema.json). For each slice and material, it
// has the position, the numbers of vertices, triangles and rings, and the area, bounding box,
// centroid and mean HU. For the asset it has the parameters, the area of each material over all
// slices, the surfaces, and the grids on which the asset stores HU (one for the material, one for
// the context). `bytes` is the size of the asset's file.
json describe_asset(const Asset& asset, std::uint64_t bytes) {
  json slices = json::array();
  Eigen::AlignedBox2d all;
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
    const Eigen::AlignedBox2d box = box_of(s.mesh, asset.lattice.step_mm());
    all.extend(box);
    slices.push_back(
        {{"index", s.index},
         {"material", s.material},
         {"z_mm", s.z_mm},
         {"vertices", s.mesh.vertices.size()},
         {"triangles", s.mesh.triangles.size()},
         {"rings", s.pslg.rings.size()},
         {"outline_segments", outline},
         {"area_mm2", area_mm2},
         {"box_mm", corners_json(box)},
         {"centroid_mm", or_null(centroid_of(s.mesh, asset.lattice.step_mm()))},
         {"mean_hu", s.mesh.triangles.empty() ? json(nullptr) : or_null(mean_hu_of(s))},
         {"measures", parse_known_json(s.measures_json)}});
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
              {"schema", kAssetSchema},
              {"lattice_bits", asset.lattice.bits},
              {"lattice_step_mm", asset.lattice.step_mm()},
              {"materials", std::move(materials)},
              {"parameters", parse_known_json(asset.parameters_json)},
              {"bytes", bytes},
              {"triangles", triangles},
              {"box_mm", corners_json(all)},
              {"surfaces", std::move(surfaces)},
              {"slices", std::move(slices)}};
  for (const HuVolume* volume : {&asset.hu, &asset.context}) {
    if (volume->planes.empty()) continue;
    out["hu_volumes"].push_back(
        {{"covers", volume->grid.covers_everything() ? "everything" : "material"},
         {"planes", volume->planes.size()},
         {"pitch_mm", {volume->grid.pitch_mm.x(), volume->grid.pitch_mm.y()}},
         {"step_hu", volume->grid.step_hu}});
    if (!volume->grid.covers_everything())
      out["hu_volumes"].back()["margin_mm"] = asset.lattice.to_mm(volume->grid.margin_steps);
  }
  if (!asset.input_key_digest.empty()) out["input_key_digest"] = asset.input_key_digest;
  return out;
}

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
    if (!mesh.add_face(handles[t[0]], handles[t[1]], handles[t[2]]).is_valid())
      return refused("slice " + std::to_string(slice.index) + ": OpenMesh finds it not manifold");
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

// Finds a point in each hole, strictly inside it and outside the islands in it. If every ring in
// the hole is reversed, the triangulation covers what is not material, and the triangles at the rim
// of the hole lie in this hole and not in a deeper one.
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

std::string number(double v) {
  return text_of(v, 17);
}

// The contents of the file: the outline's vertices and segments in mm in the slice plane, and a
// point inside each hole, by which Triangle recognises the hole. To find these points, the
// function triangulates the holes. Errors: those of triangulate().
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

// Writes three files for each slice with material: `slice_NNNN.poly` (for Triangle),
// `slice_NNNN.obj` (mm, in the patient's LPS frame) and `slice_NNNN.svg`. NNNN is the slice's
// index. If the asset has several materials, the files of material M are `slice_NNNN_M.poly` and
// so on. The folder is created if needed, and files of the same names are replaced. If a file
// cannot be made, for example because a folder has its name, no file in `folder` is changed.
//
// Returns the names of files in the folder that are named like exported slices, but do not belong
// to this export: an earlier export of other slices has written them. The function keeps these
// files. The caller should warn the user, who could take them for files of this asset.
//
// Errors: kUnwritable if a file cannot be written or `stop` was set; kRefused if a mesh is not
// manifold (for example, if an edge has more than two triangles); those of poly_text().
Result<std::vector<std::string>> export_asset(const Asset& asset,
                                              const std::filesystem::path& folder,
                                              const std::atomic<bool>* stop = nullptr) {
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

// Writes each surface in the three formats of surface_text(), to `surface.stl`, `surface.ply` and
// `surface.obj`. If the asset has several surfaces, the files of material M are `surface_M.stl`
// and so on. If a file cannot be made, for example because a folder has its name, no file
// in `folder` is changed.
// Errors: kUnwritable if a file cannot be written or `stop` was set; kRefused if the asset has no
// surface, or if a surface is not manifold.
Result<void> export_surfaces(const Asset& asset, const std::filesystem::path& folder,
                             const std::atomic<bool>* stop = nullptr) {
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

// The description as a table.
void print_description(const fs::path& file, const json& out) {
  const bool several = out["materials"].size() > 1;
  print(
      stdout,
      "%s\n  written by %s\n  lattice step 2^-%d mm, %zu triangles, %zu bytes\n  parameters %s\n"
      "  u (along a row) and v (along a column) count from the centre of the first pixel\n\n "
      " slice%s      z mm    rings  vertices  triangles   area mm2  box u mm, v mm                 "
      "     centroid u, v mm  mean HU\n",
      file, out["generator"].get<std::string>(), out["lattice_bits"].get<int>(),
      out["triangles"].get<std::size_t>(), out["bytes"].get<std::size_t>(),
      json_text(out["parameters"]), several ? " material" : "");
  for (const json& s : out["slices"]) {
    std::printf("  %5d", s["index"].get<int>());
    if (several) std::printf(" %8d", s["material"].get<int>());
    std::printf(" %9.3f %8zu %9zu %10zu %10.2f", s["z_mm"].get<double>(),
                s["rings"].get<std::size_t>(), s["vertices"].get<std::size_t>(),
                s["triangles"].get<std::size_t>(), s["area_mm2"].get<double>());
    if (s["centroid_mm"].is_null()) {
      std::printf("  no material\n");
      continue;
    }
    const auto box = s["box_mm"].get<std::array<std::array<double, 2>, 2>>();
    const auto middle = s["centroid_mm"].get<std::array<double, 2>>();
    std::printf("  %7.1f to %6.1f, %6.1f to %6.1f  %7.1f, %7.1f", box[0][0], box[1][0], box[0][1],
                box[1][1], middle[0], middle[1]);
    if (s["mean_hu"].is_null())
      std::printf("        -\n");
    else
      std::printf(" %8.0f\n", s["mean_hu"].get<double>());
  }
  if (several) {
    std::printf("\n  material   area mm2\n");
    for (std::size_t m = 0; m < out["materials"].size(); ++m) {
      const json& material = out["materials"][m];
      print(stdout, "  %8zu %10.2f  %s\n", m, material["area_mm2"].get<double>(),
            json_text(material["name"]));
    }
  }
  for (const json& volume : out.value("hu_volumes", json::array())) {
    const bool is_context = volume["covers"] == "everything";
    print(stdout, "  HU of %s: %zu planes, a sample every %.2f mm, steps of %d HU%s\n",
          is_context ? "everything around" : "the material and a margin",
          volume["planes"].get<std::size_t>(), volume["pitch_mm"][0].get<double>(),
          volume["step_hu"].get<int>(), is_context ? "; a head's can show a face" : "");
  }
  for (const json& s : out["surfaces"]) {
    std::printf("  surface of material %d: %zu triangles, 99 %% of it within %.3f mm\n",
                s["material"].get<int>(), s["triangles"].get<std::size_t>(),
                s["distance_p99_mm"].get<double>());
  }
}

// The results of the checks of an asset. The last two checks are made only if they are wanted and
// the asset is valid.
struct Checked {
  Result<void> valid, deidentified, confirmed;
  std::size_t slices = 0;

  // The first failure, or null.
  const Error* failure() const {
    for (const Result<void>* one : {&valid, &deidentified, &confirmed})
      if (!*one) return &one->error();
    return nullptr;
  }
};

Checked check(const fs::path& file, const VerifyArguments& a) {
  Checked out;
  const auto bytes = read_file(file, std::numeric_limits<std::uint32_t>::max());
  if (!bytes) return out.valid = bytes.error(), out;
  const auto asset = decode_asset(*bytes, file.string());
  if (!asset) return out.valid = asset.error(), out;
  out.valid = verify_asset(*asset, file.string());
  if (!out.valid) return out;
  if (a.deidentified) out.deidentified = check_deidentified_asset(*bytes, file.string());
  if (a.with_cgal) out.confirmed = confirm_by_cgal(*asset, file.string());
  out.slices = slice_count(*asset);
  return out;
}

// Prints the description and returns the exit code.
int run_info(const InfoArguments& a) {
  const auto asset = read_asset(a.asset);
  if (!asset) return fail(asset.error());
  std::error_code error;
  const json out = describe_asset(*asset, fs::file_size(a.asset, error));
  if (a.as_json)
    print_lines(stdout, json_text(out, 1) + "\n");
  else
    print_description(a.asset, out);
  return 0;
}

// Checks every asset and prints the outcome. Returns 0 if all assets are valid, otherwise the exit
// code of the first failure.
int run_verify(const VerifyArguments& a) {
  int code = 0;
  json out = json::array();
  for (const fs::path& file : a.assets) {
    const Checked checked = check(file, a);
    const bool is_valid = static_cast<bool>(checked.valid);
    out.push_back({{"file", file.string()}, {"valid", is_valid}});
    if (a.with_cgal) out.back()["independent"] = is_valid && checked.confirmed;
    if (a.deidentified) out.back()["private"] = is_valid && checked.deidentified;
    if (const Error* const failure = checked.failure()) {
      out.back()["reason"] = failure->message;
      const int failed = fail(*failure);
      if (code == 0) code = failed;
    } else if (!a.as_json) {
      print(stdout, "%s: valid, %zu slices%s%s\n", file, checked.slices,
            a.deidentified ? ", private" : "", a.with_cgal ? ", confirmed by CGAL" : "");
    }
  }
  if (a.as_json) print_lines(stdout, json_text(out.size() == 1 ? out[0] : out, 1) + "\n");
  return code;
}

// Verifies the asset, writes the files and returns the exit code.
int run_export(const ExportArguments& a) {
  const std::filesystem::path &file = a.asset, &folder = a.folder;
  const auto asset = read_asset(file);
  if (!asset) return fail(asset.error());
  // Only a valid asset is exported, because other programs may not detect errors.
  if (const auto proved = verify_asset(*asset, file.string()); !proved) return fail(proved.error());
  stop_on_signals();
  if (a.surface) {
    const auto done = export_surfaces(*asset, folder, &stop_requested);
    if (done) return 0;
    const bool is_file = done.error().code == ExitCode::kRefused;
    return fail({done.error().code, (is_file ? file.string() + ": " : "") + done.error().message});
  }
  const auto others = export_asset(*asset, folder, &stop_requested);
  if (!others) return fail(others.error());
  if (!others->empty()) {
    print(
        stderr, "%s: warning: %s: still holds %s%s of another export\n", kProgram, folder.string(),
        others->front(),
        others->size() == 1 ? "" : (" and " + std::to_string(others->size() - 1) + " more files"));
  }
  return 0;
}

}  // namespace

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

Command add_info(CLI::App& command) {
  const auto made = std::make_shared<InfoArguments>();
  InfoArguments& a = *made;
  command.add_option("ASSET", a.asset, "the asset (.glb)")->required();
  command.add_flag("--json", a.as_json, "print JSON");
  return [made] { return run_info(*made); };
}

Command add_verify(CLI::App& command) {
  const auto made = std::make_shared<VerifyArguments>();
  VerifyArguments& a = *made;
  command.add_option("ASSET", a.assets, "one or more assets (.glb)")->required();
  command.add_flag(
      "--private", a.deidentified,
      "also refuse an asset if a text in it may identify the patient, or if it has HU around\n"
      "the material (--context), which can show a face");
  command.add_flag("--independent", a.with_cgal,
                   "also compare each slice with the triangulation of the library CGAL");
  command.add_flag("--json", a.as_json, "print JSON");
  return [made] { return run_verify(*made); };
}

Command add_export(CLI::App& command) {
  const auto made = std::make_shared<ExportArguments>();
  ExportArguments& a = *made;
  command.add_option("ASSET", a.asset, "the asset (.glb)")->required();
  command.add_option("-o,--output", a.folder, "folder to write to")
      ->type_name("FOLDER")
      ->required();
  command.add_flag("--surface", a.surface,
                   "write the asset's closed surface instead, as .stl, .ply and .obj");
  return [made] { return run_export(*made); };
}

}  // namespace trocar::pipeline
