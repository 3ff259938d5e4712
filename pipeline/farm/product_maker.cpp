// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/product_maker.h"

#include <sys/mman.h>

#include <random>
#include <system_error>
#include <utility>

#include "formats/base/file_descriptor.h"
#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "pipeline/farm/action_key.h"
#include "pipeline/farm/atomic_file.h"
#include "pipeline/farm/command.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// A folder in the store's tmp/ that looks like the store to a command: the scene states its asset's
// path from its own folder.
class WorkFolder {
 public:
  WorkFolder(const Store& store, const std::string& scan)
      : path_(temporary_name(store.tmp())), product_(path_ / "products" / scan) {
    fs::create_directories(product_, error_);
    if (!error_) fs::create_directories(path_ / "assets", error_);
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  ~WorkFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }

  Result<void> ready() const {
    if (error_) return unwritable(path_.string() + ": " + error_.message());
    return {};
  }
  // A copy, because trocar-run follows links before it states a path.
  Result<void> add_copy(const fs::path& file, const fs::path& copy) {
    fs::copy_file(file, copy, error_);
    if (error_) return unwritable(copy.string() + ": " + error_.message());
    return {};
  }
  fs::path asset(const std::string& scan) const { return path_ / "assets" / (scan + ".glb"); }
  const fs::path& product() const { return product_; }

 private:
  fs::path path_, product_;
  std::error_code error_;
};

void add_options(const json& parameters, std::vector<std::string>& words) {
  for (const auto& [name, value] : parameters.items())
    add_option(name, value, words);
}

std::vector<std::string> mesh_words(const ProductPrograms& programs, const CollectionScan& scan,
                                    const WantedProduct& product,
                                    const std::vector<fs::path>& inputs, const fs::path& output) {
  std::vector<std::string> words = {programs.mesh};
  if (product.kind == ProductKind::kPreview) words.emplace_back("preview");
  add_options(product_parameters(scan, product), words);
  if (!scan.series.empty()) words.push_back("--series=" + scan.series);
  words.insert(words.end(), {"--jobs=1", "--quiet", "-o", output.string(), "--"});
  for (const fs::path& input : inputs)
    words.push_back(input.string());
  return words;
}

// `input` is the asset for a scene, and the scene for a check, which has no output but its text.
std::vector<std::string> run_words(const ProductPrograms& programs, const WantedProduct& product,
                                   const fs::path& input, const fs::path& output) {
  std::vector<std::string> words = {programs.run};
  if (product.kind == ProductKind::kScene) {
    words.insert(words.end(), {"--new-scene", input.string(), "-o", output.string()});
  } else {
    words.insert(words.end(), {input.string(), "--check"});
  }
  add_options(product.parameters, words);
  return words;
}

// Removes the path of a temporary folder from a message, so that the store's index is the same in
// every run.
Error without(Error error, const std::string& path) {
  for (std::size_t at = 0; (at = error.message.find(path, at)) != std::string::npos;)
    error.message.erase(at, path.size());
  return error;
}

json action_of_product(const ProductWork& work, const WantedProduct& product,
                       const ScanEntry& entry) {
  json out = {{"schema", "trocar.action/1"},
              {"product", product_name(product.kind)},
              {"program", work.programs.digest_for(product.kind)},
              {"parameters", product.parameters}};
  if (!is_made_by_run(product.kind)) {
    out["asset_action"] = work.action;
    return out;
  }
  out["scan"] = work.scan.name;  // the scene has it
  out["asset"] = entry.outputs->asset.sha256;
  if (product.kind == ProductKind::kCheck)
    out["scene"] = entry.products.at(product_name(ProductKind::kScene)).file->sha256;
  return out;
}

Result<Object> make(const ProductWork& work, const WantedProduct& product, const ScanEntry& entry) {
  WorkFolder folder(work.store, work.scan.name);
  if (auto ok = folder.ready(); !ok) return ok.error();
  const fs::path output = fs::absolute(folder.product() / product_file(product.kind));
  Command command;
  command.output = output.string() + ".out";
  command.errors = output.string() + ".err";
  if (is_made_by_run(product.kind)) {
    const auto asset = folder.asset(work.scan.name);
    if (auto ok = folder.add_copy(work.store.content_file(entry.outputs->asset.sha256), asset); !ok)
      return ok.error();
    command.folder = output.parent_path();
    fs::path input = fs::path("../../assets") / asset.filename();
    if (product.kind == ProductKind::kCheck) {
      const Object& scene = *entry.products.at(product_name(ProductKind::kScene)).file;
      const fs::path copy = folder.product() / product_file(ProductKind::kScene);
      if (auto ok = folder.add_copy(work.store.content_file(scene.sha256), copy); !ok)
        return ok.error();
      input = copy.filename();
      command.output = output;
    }
    command.words = run_words(work.programs, product, input, output.filename());
  } else {
    command.words = mesh_words(work.programs, work.scan, product, work.inputs, output);
  }
  const auto done = run_command(command, work.stop);
  // The command has read the scan's files again. If they have changed, what it made, or why it
  // failed, does not belong to the product's key.
  if (!is_made_by_run(product.kind)) {
    if (auto ok = work.check_inputs(); !ok) return ok.error();
  }
  if (!done) return without(done.error(), folder.product().string() + "/");
  const auto bytes = read_file(output);
  if (!bytes) return bug("it wrote no " + output.filename().string());
  return work.store.put_content(*bytes, {});
}

}  // namespace

void add_option(const std::string& name, const json& value, std::vector<std::string>& words) {
  if (value.is_boolean()) return words.push_back("--" + name);
  for (const json& one : value.is_array() ? value : json::array({value}))
    words.push_back("--" + name + "=" +
                    (one.is_string() ? one.get<std::string>() : json_text(one)));
}

json product_parameters(const CollectionScan& scan, const WantedProduct& product) {
  json out = scan.parameters;
  if (product.kind == ProductKind::kSurface) {
    for (const char* of_asset : {"lines", "colour", "context"})
      out.erase(of_asset);
    out["surface"] = true;
  }
  out.update(product.parameters);
  return out;
}

Result<void> check_options(const CollectionScan& scan, const WantedProduct& product,
                           const ProductPrograms& programs, const std::atomic<bool>* stop) {
  // A file in memory for the program's message, so that a dry run writes nothing.
  const FileDescriptor messages(::memfd_create("messages", MFD_CLOEXEC));
  if (messages.get() < 0) return {};  // the options are then checked when the product is made
  const fs::path no_input = "/dev/null/input";
  // The CT of a label map is an input, too. A defect of this scan's CT must not refuse the others.
  CollectionScan any = scan;
  if (any.parameters.contains("hu")) any.parameters["hu"] = no_input.string();
  // trocar-mesh looks for the folder of its output first.
  std::error_code ignored;
  const fs::path no_output = fs::temp_directory_path(ignored) /
                             ("trocar-options." + std::to_string(std::random_device()()) + ".png");
  Command command;
  command.words = is_made_by_run(product.kind)
                      ? run_words(programs, product, no_input, no_output)
                      : mesh_words(programs, any, product, {no_input}, no_output);
  command.output = "/dev/null";
  command.errors = "/proc/self/fd/" + std::to_string(messages.get());
  auto done = run_command(command, stop);
  if (done || done.error().code != ExitCode::kUsage) return {};  // it misses its input
  return done;
}

Result<ProductsDone> make_products(const ProductWork& work, ScanEntry& entry) {
  const auto before = std::exchange(entry.products, {});
  ProductsDone out;
  bool has_new_failure = false;
  const auto fail = [&](const char* name, const Error& error, bool is_known) {
    if (!out.failure) out.failure = error.after(std::string(name) + ": ");
    has_new_failure |= !is_known;
  };
  for (const WantedProduct& product : work.scan.products) {
    const char* const name = product_name(product.kind);
    if (work.stop != nullptr && work.stop->load()) return refused_for_now("interrupted");
    StoredProduct now{"", work.programs.digest_for(product.kind), product.parameters};
    const auto scene = entry.products.find(product_name(ProductKind::kScene));
    if (product.kind == ProductKind::kCheck && !scene->second.file) {
      now.reason = "there is no scene";
      now.exit_code = scene->second.exit_code;
      now.is_lasting = scene->second.is_lasting;
      entry.products.emplace(name, std::move(now));
      continue;
    }
    const json action = action_of_product(work, product, entry);
    now.key = key_of(action);
    const auto last = before.find(name);
    const bool has_failed_before = last != before.end() && last->second.is_lasting &&
                                   last->second.key == now.key && !work.retry;
    if (has_failed_before) {
      now = last->second;
      fail(name, {static_cast<ExitCode>(now.exit_code), now.reason}, true);
    } else if ((now.file = work.store.find_product(now.key))) {
      // It is in the store.
    } else if (auto made = make(work, product, entry); !made) {
      now.reason = made.error().message;
      now.exit_code = static_cast<int>(made.error().code);
      now.is_lasting = !made.error().is_temporary && (made.error().code == ExitCode::kUsage ||
                                                      made.error().code == ExitCode::kRefused);
      fail(name, made.error(), false);
    } else {
      now.file = *made;
      if (auto ok = work.store.put_product(now.key, action, *made); !ok) return ok.error();
      ++out.made;
    }
    entry.products.emplace(name, std::move(now));
  }
  out.is_known = out.failure.has_value() && !has_new_failure;
  return out;
}

}  // namespace trocar::farm
