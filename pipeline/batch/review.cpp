// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/review.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <limits>
#include <map>
#include <opencv2/imgproc.hpp>
#include <span>
#include <string_view>
#include <system_error>
#include <tuple>
#include <vector>

#include "embedded/pipeline/batch/review_page.js.h"
#include "formats/asset/asset.h"
#include "formats/base/files.h"
#include "formats/base/html_page.h"
#include "formats/base/json.h"
#include "pipeline/batch/scan_files.h"
#include "pipeline/batch/store.h"
#include "pipeline/contour/outline_distance.h"
#include "pipeline/preview/preview_sheet.h"
#include "pipeline/read/parallel_for.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using farm::Object;
using farm::Store;
using nlohmann::json;

// --- a small picture of an asset: its middle slice with its mesh

// All colours are RGB. The picture is drawn larger and then reduced, which makes its lines smooth.
constexpr int kLarger = 3, kShift = 4;
const cv::Scalar kPaper(20, 22, 25), kInk(255, 165, 0);
constexpr double kDarkest = 0.35, kEdge = 0.62, kMarginShare = 0.04;
constexpr std::array<std::array<double, 3>, 6> kMaterials{{{235, 228, 214},
                                                           {86, 180, 233},
                                                           {0, 158, 115},
                                                           {240, 228, 66},
                                                           {204, 121, 167},
                                                           {213, 94, 0}}};

struct HuRange {
  float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
};

// The HU at a triangle's centroid; NaN if the asset has none.
float hu_at(const Asset& asset, const AssetSlice& slice, const Triangle& t) {
  const HuPlane* const plane = asset.hu.find(slice.index);
  if (plane == nullptr) return std::numeric_limits<float>::quiet_NaN();
  double x = 0, y = 0;
  for (const std::uint32_t v : t) {
    x += asset.lattice.to_mm(slice.mesh.vertices[v].x) / 3;
    y += asset.lattice.to_mm(slice.mesh.vertices[v].y) / 3;
  }
  return plane->at(x, y);
}

// Brightness of a triangle, from 0 for the lowest HU of the slice to 1 for the highest.
double brightness(float hu, const HuRange& range) {
  if (std::isnan(hu) || !(range.high > range.low)) return 1;
  return (static_cast<double>(hu) - range.low) / (static_cast<double>(range.high) - range.low);
}

cv::Scalar colour(int material, double light) {
  const auto& c = kMaterials[static_cast<std::size_t>(material) % kMaterials.size()];
  return {c[0] * light, c[1] * light, c[2] * light};
}

// The AssetSlice::index of the middle one of the slices with triangles; std::nullopt if there is
// no such slice.
std::optional<int> middle_slice(const Asset& asset) {
  std::vector<int> with;
  for (const AssetSlice& s : asset.slices) {
    if (!s.mesh.triangles.empty() && (with.empty() || with.back() != s.index))
      with.push_back(s.index);
  }
  if (with.empty()) return {};
  return with[with.size() / 2];
}

struct Thumbnail {
  Picture picture;
  double width_mm = 0, height_mm = 0;  // size of the material's bounding box in the slice
};

// Draws the slice whose AssetSlice::index is `slice` into a square of size_px x size_px pixels.
// The picture shows the triangles, their edges, and the outline. Materials have different colours,
// which repeat after six. If the asset has HU, a triangle with higher HU at its centroid is
// brighter. Precondition: the slice has triangles.
Thumbnail draw_thumbnail(const Asset& asset, int slice, int size_px) {
  std::vector<const AssetSlice*> shown;
  Eigen::AlignedBox2d box;
  HuRange range;
  for (const AssetSlice& s : asset.slices) {
    if (s.index != slice || s.mesh.triangles.empty()) continue;
    shown.push_back(&s);
    for (const LatticePoint p : s.mesh.vertices)
      box.extend(Eigen::Vector2d(p.x, p.y));
    for (const Triangle& t : s.mesh.triangles) {
      const float hu = hu_at(asset, s, t);
      if (hu < range.low) range.low = hu;
      if (hu > range.high) range.high = hu;
    }
  }
  const double width = box.sizes().x(), height = box.sizes().y();
  const int large = size_px * kLarger;
  const double scale = large * (1 - 2 * kMarginShare) / std::max({width, height, 1.0});
  const auto pixel = [&](LatticePoint p) {
    const auto along = [&](double value, double low, double size) {
      return static_cast<int>(
          std::lround(((value - low - size / 2) * scale + large / 2.0) * (1 << kShift)));
    };
    return cv::Point(along(p.x, box.min().x(), width), along(p.y, box.min().y(), height));
  };
  cv::Mat sheet(large, large, CV_8UC3, kPaper);
  for (const AssetSlice* s : shown) {
    for (const Triangle& t : s->mesh.triangles) {
      const std::array<cv::Point, 3> corners{pixel(s->mesh.vertices[t[0]]),
                                             pixel(s->mesh.vertices[t[1]]),
                                             pixel(s->mesh.vertices[t[2]])};
      const double light = kDarkest + (1 - kDarkest) * brightness(hu_at(asset, *s, t), range);
      cv::fillConvexPoly(sheet, corners.data(), 3, colour(s->material, light), cv::LINE_8, kShift);
      for (std::size_t k = 0; k < 3; ++k)
        cv::line(sheet, corners[k], corners[(k + 1) % 3], colour(s->material, light * kEdge), 1,
                 cv::LINE_8, kShift);
    }
  }
  for (const AssetSlice* s : shown) {
    for (const Ring& ring : s->pslg.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i)
        cv::line(sheet, pixel(ring[i]), pixel(ring[(i + 1) % ring.size()]), kInk, kLarger,
                 cv::LINE_8, kShift);
    }
  }
  cv::Mat small;
  cv::resize(sheet, small, {size_px, size_px}, 0, 0, cv::INTER_AREA);
  const double step = asset.lattice.step_mm();
  return {{small.cols, small.rows, std::vector<std::uint8_t>(small.datastart, small.dataend)},
          width * step,
          height * step};
}

// --- the assets of a store

enum class Status { kDone, kFailed, kDamaged };

// The data of a scan in the store's index. An entry is small, so that the entries of all scans fit
// into memory together.
struct IndexedScan {
  std::string name;
  Status status = Status::kDamaged;
  Object asset;                                       // set if the status is kDone
  std::string reason;                                 // set if the status is not kDone
  nlohmann::json warnings = nlohmann::json::array();  // ScanEntry::warnings
};

// All scans of the store's index, sorted by name. A scan whose entry cannot be read is kDamaged.
// Errors: those of Store::names().
Result<std::vector<IndexedScan>> indexed_scans(const Store& store) {
  std::vector<IndexedScan> out;
  const auto names = store.names();  // sorted
  if (!names) return names.error();
  for (const std::string& name : *names) {
    IndexedScan scan;
    scan.name = name;
    const auto read = store.read_entry(name);
    if (!read) {
      scan.reason = read.error().is_temporary ? "its entry in the index cannot be read"
                                              : "its entry in the index is damaged";
    } else if (const auto& entry = *read) {
      scan.status = entry->is_done() ? Status::kDone : Status::kFailed;
      if (entry->is_done()) scan.asset = entry->outputs->asset;
      scan.reason = entry->reason;
      scan.warnings = entry->warnings;
    } else {
      continue;  // another process has dropped it
    }
    out.push_back(std::move(scan));
  }
  return out;
}

// Reads the asset `object` and checks that its bytes have the digest object.sha256. Errors:
// kRefused if the file is missing, has another digest, or is not an asset; the message names the
// file.
Result<Asset> read_stored_asset(const Store& store, const Object& object) {
  const fs::path file = store.content_file(object.sha256);
  const auto damaged = [&](const std::string& why) {
    return refused(file.string() + ": " + why + "; trocar-mesh batch --verify makes it again");
  };
  const auto bytes = read_file(file, object.bytes);
  if (!bytes) return damaged("cannot be read, or is longer than the index says");
  if (farm::sha256_of(*bytes) != object.sha256)
    return damaged("its bytes are not those of its digest");
  return decode_asset(*bytes, file.string());
}

// --- the differences between the assets of two stores, the most serious first

// A value in the reviewed store (`now`), and the same value in the store to compare with
// (`before`).
template <typename T>
struct Both {
  T now{}, before{};
};

double area_mm2(const Asset& asset) {
  double steps2 = 0;
  for (const AssetSlice& s : asset.slices)
    steps2 += static_cast<double>(doubled_area(s.mesh)) / 2;
  return steps2 * asset.lattice.step_mm() * asset.lattice.step_mm();
}

// The differences between two assets. Slices with material correspond to each other if their index
// and material are equal. In the numbers of slices, each material of a slice counts as a slice.
struct AssetDifference {
  // The largest two-sided Hausdorff distance between the outlines of corresponding slices,
  // accurate to 0.001 mm. If the planes of two slices differ, the outline of `before` is projected
  // onto the plane of `now`. The distance of these two slices is then the larger of two numbers:
  // the Hausdorff distance in the plane of `now`, and the largest distance between a point of the
  // outline of `before` and the point's projection.
  double hausdorff_mm = 0;
  int worst_slice = -1;    // index of the slice with hausdorff_mm; -1 if no slices correspond
  int slices_changed = 0;  // corresponding slices whose outlines or numbers of triangles differ
  Both<int> slices_alone;  // slices with material that have no corresponding slice
  Both<double> area_mm2;
  Both<std::uint64_t> triangles;
};

// The most serious first.
enum class DifferenceKind { kDamaged, kFailed, kGone, kChanged, kRepaired, kNew };

struct ScanDifference {
  std::string name;
  DifferenceKind kind = DifferenceKind::kChanged;
  std::string reason;         // reason of kDamaged or kFailed
  AssetDifference geometry;   // set if the kind is kChanged
  Both<std::uint64_t> bytes;  // sizes of the assets
};
struct StoreDiff {
  std::size_t same = 0;  // number of scans whose assets are equal, or that failed in both stores
  std::vector<ScanDifference> differences;
};
using SliceKey = std::pair<int, int>;  // slice, material

// The number of triangles of all slices.
std::uint64_t triangles_of(const Asset& asset) {
  std::uint64_t out = 0;
  for (const AssetSlice& s : asset.slices)
    out += s.mesh.triangles.size();
  return out;
}

std::map<SliceKey, const AssetSlice*> slices_with_material(const Asset& asset) {
  std::map<SliceKey, const AssetSlice*> out;
  for (const AssetSlice& s : asset.slices) {
    if (!s.pslg.rings.empty()) out[{s.index, s.material}] = &s;
  }
  return out;
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

template <typename T>
T magnitude(const Both<T>& of) {
  return std::max(of.now, of.before) - std::min(of.now, of.before);
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
  const auto a = read_stored_asset(now, pair.now);
  const auto b = a ? read_stored_asset(before, pair.before) : a;
  if (!a || !b) {
    out.kind = DifferenceKind::kDamaged;
    out.reason = (a ? b : a).error().message;
    return;
  }
  out.geometry = compare_assets(*a, *b);
}

// The name of a kind. A scan has the first kind of this list whose condition holds:
//  - "damaged": the scan's entry in the reviewed store cannot be read. Or both stores name an
//    asset for the scan, the digests of the two assets differ, and one of the two assets cannot be
//    read.
//  - "failed": the scan failed in the reviewed store, but not in the store to compare with.
//  - "gone": only the store to compare with has the scan.
//  - "changed": both stores have an asset, and the digests of the two assets differ.
//  - "repaired": the reviewed store names an asset for the scan. In the store to compare with, the
//    scan failed, or its entry cannot be read.
//  - "new": the reviewed store names an asset for the scan, and the store to compare with does not
//    have the scan.
const char* name_of(DifferenceKind kind) {
  constexpr std::array kNames = {"damaged", "failed", "gone", "changed", "repaired", "new"};
  return kNames.at(static_cast<std::size_t>(kind));
}

// Compares two stores. Only assets whose digests differ are read. The differences are ordered by
// kind. Within a kind, they are ordered by these numbers, the largest first: slices without a
// corresponding slice, hausdorff_mm, and the differences of area, triangles and bytes. Equal ones
// are ordered by name. Errors: kUnwritable if `stop` was set; the comparison then ends early.
Result<StoreDiff> compare_stores(const Store& now, const Store& before,
                                 const std::atomic<bool>* stop) {
  const auto scans_now = indexed_scans(now);
  if (!scans_now) return scans_now.error();
  const auto scans_before = indexed_scans(before);
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

// --- the pages

constexpr int kThumbnail_px = 168;
constexpr std::size_t kScansPerPage = 240;  // largest number of cards on a page
constexpr std::size_t kMaxRows = 500;       // largest number of rows in the table of differences
constexpr std::string_view kGenerator = "trocar-mesh review";
// Largest number of scans in the index. A scan takes 20 to 35 bytes of text in addition to its name,
// and a name has at most 120 bytes, so the index has at most about 15 MB.
constexpr std::size_t kMaxIndexed = 100'000;

Result<Store> open_store(const fs::path& folder) {
  std::error_code ignored;
  if (!fs::exists(folder / "trocar-store.json", ignored))
    return refused(folder.string() + ": is no store of trocar-mesh batch");
  return Store::open_for_reading(folder);
}

// Every byte that has a meaning in a URL, or none in ASCII, is written as %XX.
std::string url_encoded(std::string_view path) {
  constexpr std::string_view kPlain =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~/";
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  std::string out;
  for (const char c : path) {
    if (kPlain.find(c) != std::string_view::npos) {
      out += c;
      continue;
    }
    const auto byte = static_cast<unsigned char>(c);
    out += {'%', kDigits[byte >> 4], kDigits[byte & 15]};
  }
  return out;
}

// The absolute path of a folder without "." and "..". Where `..` follows a symbolic link, only the
// file system can resolve it.
fs::path plain_path(const fs::path& folder) {
  std::error_code ignored;
  fs::path out = fs::absolute(folder, ignored);
  if (std::find(out.begin(), out.end(), "..") != out.end())
    out = fs::weakly_canonical(out, ignored);
  out = out.lexically_normal();
  return out.has_filename() ? out : out.parent_path();
}

// The URL of the store for a page, with a slash at its end; empty if the store is the page's folder.
// It is relative if possible, so that page and store can be moved together. If the page's path goes
// through a symbolic link, a relative URL can lead astray, because for `..` a browser only cuts off
// the last part of the page's address. So it is relative only if it works with the page's path as it
// was given and with symbolic links resolved, else absolute (`file:///...`).
std::string store_url(const fs::path& page, const fs::path& store) {
  std::error_code error;
  const fs::path from = plain_path(fs::absolute(page, error).parent_path()), to = plain_path(store);
  const fs::path relative = to.lexically_relative(from);
  const fs::path resolved = (fs::weakly_canonical(from, error) / relative).lexically_normal();
  if (relative.empty() || !fs::equivalent(resolved, to, error))
    return "file://" + url_encoded(to.generic_string()) + "/";
  return relative == "." ? "" : url_encoded(relative.generic_string()) + "/";
}

json difference_json(const ScanDifference& d) {
  json out = {{"scan", d.name},
              {"kind", name_of(d.kind)},
              {"bytes", d.bytes.now},
              {"bytes_before", d.bytes.before}};
  if (!d.reason.empty()) out["reason"] = d.reason;
  if (d.kind != DifferenceKind::kChanged) return out;
  const AssetDifference& g = d.geometry;
  out["hausdorff_mm"] = g.hausdorff_mm;
  out["worst_slice"] = g.worst_slice < 0 ? json() : json(g.worst_slice);
  out["slices_changed"] = g.slices_changed;
  out["slices_only_now"] = g.slices_alone.now;
  out["slices_only_before"] = g.slices_alone.before;
  out["area_mm2"] = g.area_mm2.now;
  out["area_mm2_before"] = g.area_mm2.before;
  out["triangles"] = g.triangles.now;
  out["triangles_before"] = g.triangles.before;
  return out;
}

// The data of a scan that a page shows.
struct Card {
  std::string name;
  Status status = Status::kDamaged;
  std::optional<Object> now, before;
  std::string reason;  // reason why there is no picture of the asset
  const ScanDifference* difference = nullptr;
  json warnings = json::array();
};

// Picture and figures of an asset. If the asset is damaged, there is only "error"; if it has no
// triangles, only "bytes".
json asset_json(const Store& store, const Object& object) {
  const auto asset = read_stored_asset(store, object);
  if (!asset) return {{"error", asset.error().message}};
  json out = {{"bytes", object.bytes}};
  const auto slice = middle_slice(*asset);
  if (!slice) return out;
  const Thumbnail thumbnail = draw_thumbnail(*asset, *slice, kThumbnail_px);
  out["slice"] = *slice;
  out["slices"] = slice_count(*asset);
  out["size_mm"] = {thumbnail.width_mm, thumbnail.height_mm};
  out["triangles"] = triangles_of(*asset);
  if (const auto png = png_of(thumbnail.picture)) out["src"] = png_url(*png);
  return out;
}

json card_json(const Store& now, const Store* before, const std::string& url, const Card& card) {
  json out = {{"name", card.name}};
  if (card.now) {
    out["asset"] = asset_json(now, *card.now);
    out["links"]["report"] = url + "reports/" + url_encoded(card.name) + ".json";
    if (!out["asset"].contains("error"))
      out["links"]["asset"] = url + "assets/" + url_encoded(card.name) + ".glb";
  }
  if (before != nullptr && card.now && card.before)
    out["before"] = asset_json(*before, *card.before);
  if (card.difference != nullptr) out["difference"] = difference_json(*card.difference);
  if (!card.reason.empty()) out["reason"] = card.reason;
  for (const json& warning : card.warnings)
    out["warnings"].push_back({{"code", warning["code"]}, {"sentence", warning["sentence"]}});
  return out;
}

// The scans that differ, most serious first, then those that are not done, then the others.
std::vector<Card> cards_of(const std::vector<IndexedScan>& scans,
                           const std::map<std::string, Object>& before,
                           const std::vector<ScanDifference>& differences) {
  std::map<std::string, const IndexedScan*> by_name;
  for (const IndexedScan& scan : scans)
    by_name[scan.name] = &scan;
  std::vector<Card> out;
  const auto add = [&](const IndexedScan& scan, const ScanDifference* difference) {
    Card card{scan.name, scan.status, {}, {}, scan.reason, difference, scan.warnings};
    if (scan.status == Status::kDone) card.now = scan.asset;
    const auto other = before.find(scan.name);
    if (difference != nullptr && other != before.end()) card.before = other->second;
    out.push_back(std::move(card));
  };
  for (const ScanDifference& d : differences) {
    const auto at = by_name.find(d.name);
    if (at == by_name.end()) continue;  // a scan that is gone is only in the table
    add(*at->second, &d);
    by_name.erase(at);
  }
  for (const bool is_done : {false, true}) {
    for (const auto& [name, scan] : by_name) {
      if ((scan->status == Status::kDone) == is_done) add(*scan, nullptr);
    }
  }
  return out;
}

fs::path page_file(const fs::path& first, std::size_t page) {
  if (page == 0) return first;
  return first.parent_path() /
         (first.stem().string() + "-" + std::to_string(page + 1) + first.extension().string());
}

// Is this a page of the review whose first page is `first`?
bool is_page_of(const fs::path& file, const json& first) {
  const auto bytes = read_file(file);
  const std::string pages = embedded_json("\"pages\":[" + json_text(first));
  return bytes && std::string_view(reinterpret_cast<const char*>(bytes->data()), bytes->size())
                          .find(pages) != std::string_view::npos;
}

bool is_review(const fs::path& file) {
  std::string head(512, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  return head.find("<meta name=\"generator\" content=\"" + std::string(kGenerator) + "\">") !=
         std::string::npos;
}

// Refuses to write a page over a file that is not a page of the same review. The first page, which
// the user names, is overwritten in any case.
Result<void> check_other_pages(const fs::path& first, std::size_t pages) {
  const json name = first.filename().string();
  for (std::size_t page = 1; page < pages; ++page) {
    const fs::path file = page_file(first, page);
    std::error_code ignored;
    if (!fs::exists(fs::symlink_status(file, ignored))) continue;
    if (fs::is_regular_file(file, ignored) && is_review(file) && is_page_of(file, name)) continue;
    return unwritable(file.string() + ": exists, and is not a page of " + first.string() +
                      "; choose another name for the review, or remove the file");
  }
  return {};
}

// The first kMaxRows differences, each with the page on which its scan is shown.
json difference_rows(const StoreDiff& diff) {
  json rows = json::array();
  std::size_t cards = 0;
  for (const ScanDifference& d : diff.differences) {
    if (rows.size() == kMaxRows) break;
    rows.push_back(difference_json(d));
    if (d.kind != DifferenceKind::kGone) rows.back()["page"] = cards++ / kScansPerPage;
  }
  return {{"further", diff.differences.size() - rows.size()}, {"scans", std::move(rows)}};
}

// The index of all scans: one array for each column, because that is the shortest text. The position
// of a scan in the arrays determines its page. "further" is the number of scans without a row.
json empty_index(std::size_t scans) {
  const std::size_t rows = std::min(scans, kMaxIndexed);
  json index = {{"further", scans - rows}};
  for (const char* column : {"names", "flags", "bytes", "triangles", "slices"})
    index[column] = json::array_t(rows);
  return index;
}

// Sets the row of the scan whose card is number `place`, counted from 0 over all pages.
void set_row(json& index, std::size_t place, const json& card, Status status) {
  enum Flag : unsigned { kDone = 1, kFailed = 2, kDamaged = 4, kDifferent = 8, kWarned = 16 };
  if (place >= index["names"].size()) return;
  const json asset = card.value("asset", json::object());
  unsigned flags = status == Status::kDone ? kDone : kFailed;
  if (status == Status::kDamaged || asset.contains("error")) flags = kDamaged;
  if (card.contains("difference")) flags |= kDifferent;
  if (card.contains("warnings")) flags |= kWarned;
  index["names"][place] = card["name"];
  index["flags"][place] = flags;
  for (const char* figure : {"bytes", "triangles", "slices"})
    if (asset.contains(figure)) index[figure][place] = asset[figure];
}

// The numbers of a review. Damaged assets are counted when their cards are made.
struct Counts {
  std::size_t done = 0, failed = 0, damaged = 0, warned = 0;
  std::uint64_t bytes = 0;

  explicit Counts(const std::vector<IndexedScan>& scans) {
    for (const IndexedScan& scan : scans) {
      done += scan.status == Status::kDone ? 1 : 0;
      failed += scan.status == Status::kFailed ? 1 : 0;
      damaged += scan.status == Status::kDamaged ? 1 : 0;
      warned += scan.warnings.empty() ? 0 : 1;
      bytes += scan.asset.bytes;
    }
  }

  void add(const json& card) {
    damaged += card.contains("asset") && card["asset"].contains("error") ? 1 : 0;
  }

  json as_json() const {
    return {{"done", done},
            {"failed", failed},
            {"damaged", damaged},
            {"warned", warned},
            {"bytes", bytes}};
  }
};

// The store to compare with, if there is one.
struct Comparison {
  std::optional<Store> store;
  StoreDiff diff;
  std::map<std::string, Object> assets;  // of the other store, by the scan's name
};

Result<Comparison> compare(const ReviewOptions& options, const Store& store) {
  Comparison out;
  if (options.against.empty()) return out;
  if (const auto ok = open_store(options.against).into(out.store); !ok) return ok.error();
  if (const auto ok = compare_stores(store, *out.store, options.stop).into(out.diff); !ok)
    return ok.error();
  auto scans = indexed_scans(*out.store);
  if (!scans) return scans.error();
  for (IndexedScan& scan : *scans) {
    if (scan.status == Status::kDone) out.assets[scan.name] = scan.asset;
  }
  return out;
}

std::vector<json> cards_json(const ReviewOptions& options, const Store& now, const Store* before,
                             std::span<const Card> cards) {
  const std::string url = store_url(options.page, options.store);
  std::vector<json> out(cards.size());
  parallel_for(static_cast<int>(cards.size()), [&](int i) {
    if (options.stop != nullptr && *options.stop) return;
    const auto k = static_cast<std::size_t>(i);
    out[k] = card_json(now, before, url, cards[k]);
  });
  return out;
}

}  // namespace

Result<json> write_review(const ReviewOptions& options) {
  const auto store = open_store(options.store);
  if (!store) return store.error();
  const auto indexed = indexed_scans(*store);
  if (!indexed) return indexed.error();
  const std::vector<IndexedScan>& scans = *indexed;
  if (scans.empty()) return refused(options.store.string() + ": the store has no scans");
  const auto other = compare(options, *store);
  if (!other) return other.error();

  Counts counts(scans);
  const std::vector<Card> cards = cards_of(scans, other->assets, other->diff.differences);
  const std::size_t pages = (cards.size() + kScansPerPage - 1) / kScansPerPage;
  if (auto ok = check_other_pages(options.page, pages); !ok) return ok.error();
  json files = json::array();
  for (std::size_t page = 0; page < pages; ++page)
    files.push_back(page_file(options.page, page).filename().string());
  json index = empty_index(cards.size());
  std::size_t done = 0;
  // The first page is written last, because its index has the figures of all assets.
  for (std::size_t k = 1; k <= pages; ++k) {
    const std::size_t page = k % pages, first = page * kScansPerPage,
                      size = std::min(kScansPerPage, cards.size() - first);
    const auto on_page = std::span(cards).subspan(first, size);
    std::vector<json> made =
        cards_json(options, *store, other->store ? &*other->store : nullptr, on_page);
    if (options.stop != nullptr && *options.stop) return unwritable("interrupted");
    for (std::size_t i = 0; i < size; ++i) {
      counts.add(made[i]);
      set_row(index, first + i, made[i], on_page[i].status);
    }
    json shown = {{"pages", files}, {"page", page}, {"scans", cards.size()}};
    shown["cards"] = std::move(made);
    if (page == 0) {
      shown["counts"] = counts.as_json();
      shown["index"].swap(index);
      shown["per_page"] = kScansPerPage;
      if (other->store) shown["differences"] = difference_rows(other->diff);
    }
    const std::string text = html_page(kGenerator, kReviewPage, {{"review", json_text(shown)}});
    if (auto ok = write_file_atomically(page_file(options.page, page), text); !ok)
      return ok.error();
    done += size;
    if (options.progress) options.progress(done, cards.size());
  }
  const json first = page_file(options.page, 0).filename().string();
  std::error_code ignored;
  for (std::size_t page = pages;; ++page) {
    const fs::path old = page_file(options.page, page);
    if (!is_review(old) || !is_page_of(old, first)) break;
    fs::remove(old, ignored);
  }

  json out = counts.as_json();
  out["schema"] = "trocar.review/1";
  out["scans"] = scans.size();
  out["pages"] = std::move(files);
  if (other->store) {
    out["same"] = other->diff.same;
    out["differences"] = json::array();
    for (const ScanDifference& d : other->diff.differences)
      out["differences"].push_back(difference_json(d));
  }
  return out;
}

}  // namespace trocar::pipeline
