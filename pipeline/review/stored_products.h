// SPDX-License-Identifier: GPL-3.0-or-later
// The products of a scan, as the store's index lists them.
// Tests: tests/e2e/review_test.py
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "pipeline/farm/store.h"

namespace trocar::pipeline {

/// A kind of product, and its file in the folder `products/NAME` of the store.
struct ProductKind {
  std::string_view name, file;
};
inline constexpr std::array<ProductKind, 4> kProductKinds = {{{"preview", "preview.png"},
                                                              {"surface", "surface.stl"},
                                                              {"scene", "scene.json"},
                                                              {"check", "check.txt"}}};

struct StoredProduct {
  std::string_view kind;
  std::filesystem::path file;  ///< path within the store; empty if the product failed
  std::string reason;          ///< reason of the failure
  bool is_done() const { return !file.empty(); }
};

/// The scan's products in the order of kProductKinds. A product whose file is missing counts as
/// failed. The index may come from anybody: unknown kinds and members of a wrong type are ignored,
/// and a long reason is cut.
std::vector<StoredProduct> products_of(const farm::Store& store, const std::string& scan);

}  // namespace trocar::pipeline
