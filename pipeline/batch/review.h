// SPDX-License-Identifier: GPL-3.0-or-later
// A small picture of an asset: its middle slice with its mesh.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "pipeline/batch/store.h"
#include "pipeline/preview/preview_sheet.h"

namespace trocar::pipeline {

/// The AssetSlice::index of the middle one of the slices with triangles; std::nullopt if there is
/// no such slice.
std::optional<int> middle_slice(const Asset& asset);

struct Thumbnail {
  Picture picture;
  double width_mm = 0, height_mm = 0;  ///< size of the material's bounding box in the slice
};

/// Draws the slice whose AssetSlice::index is `slice` into a square of size_px x size_px pixels.
/// The picture shows the triangles, their edges, and the outline. Materials have different colours,
/// which repeat after six. If the asset has HU, a triangle with higher HU at its centroid is
/// brighter. Precondition: the slice has triangles.
Thumbnail draw_thumbnail(const Asset& asset, int slice, int size_px);

}  // namespace trocar::pipeline

namespace trocar::farm {

// Reads and checks the assets of a store.

/// The data of a scan in the store's index. An entry is small, so that the entries of all scans fit
/// into memory together.
struct IndexedScan {
  enum class Status { kDone, kFailed, kDamaged };
  std::string name;
  Status status = Status::kDamaged;
  Object asset;                                       ///< set if the status is kDone
  std::string reason;                                 ///< set if the status is not kDone
  nlohmann::json warnings = nlohmann::json::array();  ///< ScanEntry::warnings
};

/// All scans of the store's index, sorted by name. A scan whose entry cannot be read is kDamaged.
/// Errors: those of Store::names().
Result<std::vector<IndexedScan>> indexed_scans(const Store& store);

/// Reads the asset `object` and checks that its bytes have the digest object.sha256. Errors:
/// kRefused if the file is missing, has another digest, or is not an asset; the message names the
/// file.
Result<Asset> read_stored_asset(const Store& store, const Object& object);

}  // namespace trocar::farm

namespace trocar::pipeline {

// `trocar-mesh review`: HTML pages with a picture of every asset of a store. On request, the pages
// also show the differences from another store.

inline constexpr std::size_t kScansPerPage = 240;  ///< largest number of cards on a page

struct ReviewOptions {
  std::filesystem::path store;
  std::filesystem::path against;  ///< store to compare with; empty: no comparison
  std::filesystem::path page;     ///< first page, NAME.html; the others are NAME-2.html and so on
  const std::atomic<bool>* stop = nullptr;  ///< the caller sets it to end the review early
  /// Called after each page. `done` counts the scans on the pages written so far, `total`
  /// counts all scans.
  std::function<void(std::size_t done, std::size_t total)> progress = {};
};

/// Writes the pages and returns the numbers shown in them as JSON (`trocar.review/1`).
///
/// Each scan of the store has a card with its picture. If the review compares two stores, the cards
/// of scans that differ come first, the most serious differences at the front. The cards of scans
/// that failed, or whose entry in the store's index cannot be read, follow, and then all other
/// cards; these two groups are sorted by name. A card links to the scan's report and asset in the
/// store. A missing or damaged asset is reported on its card. A page contains everything that it
/// shows; only the files to which cards link are not in it.
///
/// The first page has an index of all scans, by which it searches, filters and sorts the scans of
/// all pages; the results link to the cards. The other pages link to the first page. They have no
/// index, because otherwise the size of a review would grow with the square of the number of scans.
/// Only one page and the index are in memory at a time. The first page is written last, because the
/// index needs the numbers of all assets. Pages of an earlier, longer review with the same name are
/// removed.
///
/// Errors: kRefused if a folder is not a store, or the store has no scans; kUnwritable if a page
/// cannot be written, if a file with the name of a later page is not a page of this review, or if
/// `stop` was set.
Result<nlohmann::json> write_review(const ReviewOptions& options);

}  // namespace trocar::pipeline
