// SPDX-License-Identifier: GPL-3.0-or-later
// Makes the products of a scan (preview, surface, scene and the check of the scene), each by a
// command of trocar-mesh or trocar-run, unless the store has them already.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/farm/collection.h"
#include "pipeline/farm/product.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

/// The programs that make products: their paths and SHA-256 digests. `run` and `run_digest` are
/// empty if no scan of the collection has a product that trocar-run makes.
struct ProductPrograms {
  std::string mesh, mesh_digest, run, run_digest;
  const std::string& digest_for(ProductKind kind) const {
    return is_made_by_run(kind) ? run_digest : mesh_digest;
  }
};

/// Adds a parameter of a collection to the words of a command, as an option: a flag if the value is
/// true or false, an option with the value otherwise, and one option for each value of an array.
void add_option(const std::string& name, const nlohmann::json& value,
                std::vector<std::string>& words);

/// The parameters with which `trocar-mesh` makes a preview or a surface: the scan's parameters,
/// overridden by the product's own. A surface does not get the scan's parameters `lines`, `colour`
/// and `context`, whose results only an asset can store.
nlohmann::json product_parameters(const CollectionScan& scan, const WantedProduct& product);

/// Asks the program that makes a product whether it accepts the product's parameters for this scan,
/// by running its command with an input that does not exist. Nothing is made. This finds options
/// that do not exist or have no effect on the product, and values that are wrong whatever the scan
/// is. `stop` is that of run_command(). Errors: kUsage if the program refuses the parameters.
Result<void> check_options(const CollectionScan& scan, const WantedProduct& product,
                           const ProductPrograms& programs, const std::atomic<bool>* stop);

/// The scan whose products are to be made, and what is needed to make them.
struct ProductWork {
  const CollectionScan& scan;
  const std::vector<std::filesystem::path>& inputs;  ///< result of inputs_of(scan), scan_files.h
  const nlohmann::json& action;                      ///< the action of the scan's asset
  const ProductPrograms& programs;
  const Store& store;
  /// Returns an error if a file of the scan has changed since the scan's files were listed.
  const std::function<Result<void>()>& check_inputs;
  bool retry = false;                       ///< try known failures (store.md) again
  const std::atomic<bool>* stop = nullptr;  ///< the same flag as Work::stop; may be null
};

/// The result of making the products of a scan.
struct ProductsDone {
  std::size_t made = 0;  ///< number of products that were made
  /// The error of the first product that failed; the message begins with the product's name.
  std::optional<Error> failure;
  bool is_known = false;  ///< true: all failures are known ones, which were not tried again
};

/// Makes the wanted products and lists them in entry.products. Precondition: the asset of `entry`
/// is done. A product is made only if the store does not have it under the product's key. The key
/// is a digest of the program's digest, the product's parameters, and what the product is made of:
///  - preview and surface: the action of the scan's asset;
///  - scene: the scan's name and the digest of the asset;
///  - check: the scan's name and the digests of the asset and of the scene.
/// A preview or a surface fails if check_inputs() returns an error after its command has ended,
/// because the command reads the scan's files again. A product that fails is recorded in `entry`
/// and in ProductsDone::failure. Errors: kUnwritable if a file of the store cannot be written;
/// kRefused if `stop` was set.
Result<ProductsDone> make_products(const ProductWork& work, ScanEntry& entry);

}  // namespace trocar::farm
