// SPDX-License-Identifier: GPL-3.0-or-later
// The products of a scan besides its asset: a preview, a surface, a scene for trocar-run, and the
// output of trocar-run --check for this scene.
#pragma once

#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace trocar::farm {

enum class ProductKind { kPreview, kSurface, kScene, kCheck };
/// All kinds, in the order in which they are made: the check needs the scene.
inline constexpr std::array kProductKinds = {ProductKind::kPreview, ProductKind::kSurface,
                                             ProductKind::kScene, ProductKind::kCheck};

/// "preview", "surface", "scene" or "check".
const char* product_name(ProductKind kind);
std::optional<ProductKind> product_kind(std::string_view name);
/// The name of the product's file: "preview.png", "surface.stl", "scene.json" or "check.txt".
const char* product_file(ProductKind kind);
/// True if trocar-run makes the product from the scan's asset; false if trocar-mesh makes it from
/// the scan.
bool is_made_by_run(ProductKind kind);

struct WantedProduct {
  ProductKind kind = ProductKind::kPreview;
  /// Options of the command that makes the product: names without -- and their values, as
  /// in a collection. None of them names a file.
  nlohmann::json parameters = nlohmann::json::object();
};

}  // namespace trocar::farm
