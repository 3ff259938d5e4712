// SPDX-License-Identifier: GPL-3.0-or-later
// Batches with a program in place of meshing: its asset is a small one that is valid, its report
// the input's bytes and its parameters.
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "formats/asset/asset.h"
#include "pipeline/batch/batch_run.h"
#include "pipeline/batch/garbage.h"
#include "tests/pipeline/batch/store_fixture.h"
#include "tests/support/take.h"
#include "tests/support/temporary_folder.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::vector<std::uint8_t> small_asset() {
  AssetSlice slice;
  slice.mesh.vertices = {{0, 0}, {256, 0}, {0, 256}};
  slice.mesh.triangles = {{0, 1, 2}};
  slice.pslg.rings = {{{0, 0}, {256, 0}, {0, 256}}};
  Asset asset{Lattice{8}, {slice}, "trocar-mesh 0.0.0"};
  auto glb = encode_asset(asset);
  if (!glb) throw std::runtime_error(glb.error().message);
  return *glb;
}

// Does what its parameter `do` says.
class TestScan : public OpenedScan {
 public:
  TestScan(json given, std::vector<fs::path> inputs)
      : given_(std::move(given)), inputs_(std::move(inputs)) {}
  std::vector<NamedFile> files() const override { return {{"input", inputs_[0]}}; }
  Result<ScanOutputs> mesh() override {
    const std::string what = given_.value("do", "");
    if (what == "abort") ::raise(SIGKILL);
    if (what == "exit") ::_exit(7);
    if (what == "refuse") return refused(inputs_[0].string() + ": no");
    if (what == "refuse once" && fs::remove(inputs_[0].string() + ".once"))
      return refused(inputs_[0].string() + ": no");
    if (what == "throw") throw std::runtime_error("thrown");
    if (what == "memory") throw std::bad_alloc();
    if (what == "change") std::ofstream(inputs_[0], std::ios::app) << "more";
    if (what == "remove") fs::remove(inputs_[0]);
    if (what == "swap") {  // as if the storage gave other bytes for the same file for a while
      const auto time = fs::last_write_time(inputs_[0]);
      std::fstream(inputs_[0], std::ios::in | std::ios::out) << "y";
      fs::last_write_time(inputs_[0], time);
      return refused(inputs_[0].string() + ": no");
    }
    ScanOutputs out;
    out.asset = small_asset();
    if (what == "damage") out.asset.resize(out.asset.size() / 2);
    out.report = text_in(inputs_[0]) + given_.dump();
    return out;
  }

 private:
  json given_;
  std::vector<fs::path> inputs_;
};

class TestProgram : public ScanProgram {
 public:
  const std::string& digest() const override { return digest_; }
  Result<Parameters> parameters(const json& given) const override {
    if (given.contains("wrong")) return usage("wrong");
    if (given.contains("mask") && !fs::exists(given["mask"].get<std::string>()))
      return refused("no mask");
    return Parameters{given, {}};
  }
  bool opens_first(const std::vector<fs::path>&, const Parameters& parameters) const override {
    return parameters.canonical.value("do", "") == "unopenable" ||
           parameters.canonical.value("first", false);
  }
  // No scan has a series, or is in a folder.
  Result<std::unique_ptr<OpenedScan>> open(const json& given, const std::vector<fs::path>& inputs,
                                           const std::string& series, int) const override {
    if (given.value("do", "") == "unopenable") return refused("no image");
    if (!series.empty() || inputs[0].extension() == ".bin" || fs::is_directory(inputs[0]))
      return refused("no such image");
    return std::unique_ptr<OpenedScan>(std::make_unique<TestScan>(given, inputs));
  }

  std::string digest_ = "program";
};

class BatchTest : public testing::Test {
 protected:
  std::string add(const std::string& name, const json& parameters, const std::string& text = "x") {
    const fs::path file = folder_ / (name + ".in");
    std::ofstream(file) << text;
    collection_.scans.push_back({name, {file.string()}, "", "", parameters});
    return file.string();
  }
  BatchSummary run(bool verify = false) {
    BatchSettings settings = settings_of();
    settings.jobs = 2;
    settings.verify = verify;
    return run(settings);
  }
  BatchSettings settings_of() const {
    BatchSettings settings;
    settings.store = folder_ / "store";
    return settings;
  }
  BatchSummary run(const BatchSettings& settings) {
    const auto batch = Batch::plan(collection_, program_, settings);
    if (!batch) throw std::runtime_error(batch.error().message);
    const auto summary = batch->run();
    if (!summary) throw std::runtime_error(summary.error().message);
    EXPECT_EQ(summary->scans, summary->unchanged + summary->made + summary->found +
                                  summary->failed.size() + summary->known.size() + summary->left);
    return *summary;
  }
  BatchSummary retry() {
    BatchSettings settings = settings_of();
    settings.retry = true;
    return run(settings);
  }
  // Removes all files of the store that no scan refers to.
  void collect() const {
    const auto store = test::take(Store::open_for_writing(folder_ / "store"));
    ASSERT_TRUE(collect_garbage(store, std::chrono::seconds(0)));
  }

  test::TemporaryFolder folder_;
  Collection collection_;
  TestProgram program_;
};

TEST_F(BatchTest, EachWayToFailIsAnEntryAndTheOthersAreDone) {
  const std::string changed = add("change", {{"do", "change"}}),
                    gone = add("gone", {{"do", "remove"}});
  add("a", {{"n", 1}});
  add("abort", {{"do", "abort"}});
  add("exit", {{"do", "exit"}});
  add("refuse", {{"do", "refuse"}});
  add("throw", {{"do", "throw"}});
  add("memory", {{"do", "memory"}});
  add("damage", {{"do", "damage"}});
  add("z", {{"n", 2}});
  const BatchSummary summary = run();
  EXPECT_EQ(summary.made, 2u);
  ASSERT_EQ(summary.failed.size(), 8u);
  const auto of = [&](const std::string& scan) {
    for (const FailedScan& one : summary.failed)
      if (one.scan == scan) return one.outcome;
    return Outcome();
  };
  EXPECT_EQ(of("change").reason,
            changed + ": changed while the scan was read; run again when it is complete");
  EXPECT_EQ(of("gone").reason,
            gone + ": No such file or directory; it existed when the work on this scan began");
  EXPECT_EQ(of("abort").signal, SIGKILL);
  EXPECT_EQ(of("abort").exit_code, 137);
  EXPECT_EQ(of("abort").reason, "its process was killed by signal 9 (SIGKILL)");
  EXPECT_EQ(of("exit").exit_code, 7);
  EXPECT_EQ(of("refuse").exit_code, 3);
  EXPECT_EQ(of("throw").exit_code, 1);
  EXPECT_EQ(of("throw").reason, "internal error: thrown");
  EXPECT_EQ(of("memory").exit_code, 3);
  EXPECT_NE(of("damage").exit_code, 0);
  const auto store = Store::open_for_reading(folder_ / "store");
  for (const FailedScan& one : summary.failed) {
    const auto entry = store->entry(one.scan);
    ASSERT_TRUE(entry) << one.scan;
    EXPECT_FALSE(entry->is_done());
    EXPECT_EQ(entry->reason, one.outcome.reason);
  }
  EXPECT_EQ(fs::directory_iterator(folder_ / "store/tmp"), fs::directory_iterator());
  EXPECT_EQ(fs::directory_iterator(folder_ / "store/claims"), fs::directory_iterator());
}

std::vector<std::string> names_of(const std::vector<FailedScan>& failed) {
  std::vector<std::string> out;
  out.reserve(failed.size());
  for (const FailedScan& one : failed)
    out.push_back(one.scan);
  return out;
}

using Names = std::vector<std::string>;

TEST_F(BatchTest, AFailureThatTheScanExplainsIsKnownUntilTheScanChanges) {
  const std::string input = add("refused", {{"do", "refuse"}});
  add("done", {{"n", 1}});
  EXPECT_EQ(names_of(run().failed), Names{"refused"});
  const BatchSummary second = run();
  EXPECT_EQ(names_of(second.known), Names{"refused"});
  EXPECT_TRUE(second.failed.empty());
  EXPECT_EQ(second.known[0].outcome.reason, input + ": no");
  EXPECT_EQ(second.known[0].outcome.exit_code, 3);
  EXPECT_EQ(second.unchanged, 1u);

  std::ofstream(input) << "other bytes";
  EXPECT_EQ(names_of(run().failed), Names{"refused"}) << "input";
  EXPECT_EQ(names_of(run().known), Names{"refused"});
  collection_.scans[0].parameters["n"] = 2;
  EXPECT_EQ(names_of(run().failed), Names{"refused"}) << "parameters";
  EXPECT_EQ(names_of(run().known), Names{"refused"});
  program_.digest_ = "another program";
  EXPECT_EQ(names_of(run().failed), Names{"refused"}) << "program";
  EXPECT_EQ(names_of(run().known), Names{"refused"});
  EXPECT_EQ(names_of(retry().failed), Names{"refused"}) << "retry";
  EXPECT_EQ(names_of(run().known), Names{"refused"});

  collection_.scans[0].parameters.erase("do");
  EXPECT_EQ(run().made, 1u);
  EXPECT_EQ(run().unchanged, 2u);
}

// As if the storage had failed once, and the library that read the file had not told why.
TEST_F(BatchTest, ARefusalThatDoesNotHappenAgainIsTriedAgain) {
  const std::string input = add("a", {{"do", "refuse once"}});
  std::ofstream(input + ".once") << "";
  EXPECT_EQ(names_of(run().failed), Names{"a"});
  const BatchSummary second = run();
  EXPECT_TRUE(second.known.empty());
  EXPECT_EQ(second.made, 1u);
}

// No run may take an entry that it cannot read for none: another user may have made it.
TEST_F(BatchTest, AnEntryThatCannotBeReadEndsTheRunAndADamagedOneIsMadeAgain) {
  add("a", {{"n", 1}});
  EXPECT_EQ(run().made, 1u);
  const fs::path entry = folder_ / "store/scans/a.json";
  std::ofstream(entry) << "{";
  EXPECT_EQ(run().found, 1u);
  std::ofstream(entry) << "{";
  collection_.scans[0].parameters["do"] = "abort";
  EXPECT_EQ(names_of(run().failed), Names{"a"});
  EXPECT_EQ(fs::file_size(entry), 1u);  // so that --gc stops at it
  EXPECT_FALSE(
      collect_garbage(*Store::open_for_writing(folder_ / "store"), std::chrono::seconds(0)));
  fs::remove(entry);
  fs::create_symlink(entry, entry);
  EXPECT_FALSE(Batch::plan(collection_, program_, settings_of())->run());
}

TEST_F(BatchTest, ATouchedInputWithTheSameBytesIsTheSameFailure) {
  const std::string refused_input = add("refused", {{"do", "refuse"}});
  const std::string unopenable = add("unopenable", {{"do", "unopenable"}});
  EXPECT_EQ(run().failed.size(), 2u);
  for (const std::string& file : {refused_input, unopenable})
    fs::last_write_time(file, fs::last_write_time(file) - std::chrono::hours(1));
  EXPECT_EQ(names_of(run().known), (Names{"refused", "unopenable"}));
  // The index has the new times, so that the files are not read again.
  BatchSettings settings = settings_of();
  const auto states = Batch::plan(collection_, program_, settings)->dry_run();
  for (const NamedState& one : *states)
    EXPECT_EQ(one.state.kind, ScanState::Kind::kKnownFailure) << one.scan;
  settings.rehash = true;
  EXPECT_EQ(run(settings).known.size(), 2u);
}

// Why a scan cannot be opened may be its series, or the names of its files.
TEST_F(BatchTest, AFailureToOpenIsNotThatOfAnotherSeriesOrName) {
  for (const bool opens_first : {false, true}) {
    const std::string number = opens_first ? "1" : "0";
    add("series" + number, {{"first", opens_first}, {"n", 1}});
    collection_.scans.back().series = "7";
    const std::string input = add("name" + number, {{"first", opens_first}, {"n", 2}});
    fs::rename(input, input + ".bin");
    collection_.scans.back().paths = {input + ".bin"};
  }
  EXPECT_EQ(run().failed.size(), 4u);
  EXPECT_EQ(run().known.size(), 4u);
  for (CollectionScan& scan : collection_.scans) {
    scan.series.clear();
    const fs::path wrong = scan.paths[0];
    if (wrong.extension() != ".bin") continue;
    const fs::path right = wrong.parent_path() / wrong.stem();
    fs::rename(wrong, right);
    scan.paths = {right.string()};
  }
  EXPECT_EQ(run().made, 4u);
}

TEST_F(BatchTest, WhatIsMissingIsAKnownFailureUntilItIsThere) {
  const std::string input = add("input", {{"n", 1}});
  const std::string mask = (folder_ / "mask").string();
  add("mask", {{"mask", mask}});
  fs::remove(input);
  EXPECT_EQ(names_of(run().failed), (Names{"input", "mask"}));
  EXPECT_EQ(names_of(run().known), (Names{"input", "mask"}));
  program_.digest_ = "another program";
  EXPECT_EQ(names_of(run().failed), (Names{"input", "mask"}));
  EXPECT_EQ(names_of(run().known), (Names{"input", "mask"}));
  std::ofstream(input) << "x";
  std::ofstream(mask) << "x";
  EXPECT_EQ(run().made, 2u);
}

// The file system of the inputs may not be mounted for a while, where its folder may be left, and
// --gc may run in this time.
TEST_F(BatchTest, AnInputOutOfReachCostsNoAsset) {
  for (const bool is_empty_folder : {false, true}) {
    const std::string name = is_empty_folder ? "folder" : "input";
    const std::string input = add(name, {{"first", is_empty_folder}, {"n", 1}});
    EXPECT_EQ(run().made, 1u);
    fs::rename(input, input + ".away");
    if (is_empty_folder) fs::create_directory(input);
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(names_of(run().failed), Names{name}) << k;
      collect();
      for (const std::string& link : {"assets/" + name + ".glb", "reports/" + name + ".json"})
        EXPECT_TRUE(fs::is_regular_file(folder_ / ("store/" + link))) << link << k;
      const auto entry = test::take(Store::open_for_reading(folder_ / "store")->entry(name));
      EXPECT_FALSE(entry.is_done());
      EXPECT_FALSE(entry.is_lasting);
    }
    fs::remove(input);
    fs::rename(input + ".away", input);
    EXPECT_EQ(run().found, 1u);
    EXPECT_EQ(run().unchanged, collection_.scans.size());
  }
}

TEST_F(BatchTest, AScanWhoseProcessIsKilledKeepsItsAsset) {
  add("a", {{"n", 1}});
  EXPECT_EQ(run().made, 1u);
  collection_.scans[0].parameters["do"] = "abort";
  EXPECT_EQ(names_of(run().failed), Names{"a"});
  collect();
  EXPECT_TRUE(fs::is_regular_file(folder_ / "store/assets/a.glb"));
  collection_.scans[0].parameters.erase("do");
  EXPECT_EQ(run().found, 1u);
}

TEST_F(BatchTest, AnAssetOfOtherBytesIsNotKeptAfterAFailure) {
  const std::string input = add("a", {{"n", 1}});
  EXPECT_EQ(run().made, 1u);
  std::ofstream(input) << "other bytes";
  collection_.scans[0].parameters["do"] = "memory";
  EXPECT_EQ(names_of(run().failed), Names{"a"});
  EXPECT_FALSE(fs::is_symlink(folder_ / "store/assets/a.glb"));
}

TEST_F(BatchTest, AFailureThatTheScanDoesNotExplainIsTriedAgain) {
  for (const char* what : {"abort", "exit", "throw", "memory", "change"})
    add(what, {{"do", what}});
  const Names all = {"abort", "exit", "throw", "memory", "change"};
  EXPECT_EQ(names_of(run().failed), all);
  EXPECT_EQ(names_of(run().failed), all);
}

TEST_F(BatchTest, AFailureOfAnInputThatReadsDifferentlyThanItsDigestIsTriedAgain) {
  add("a", json::object());
  EXPECT_EQ(run().made, 1U);
  collection_.scans[0].parameters = {{"do", "swap"}};
  for (int i = 0; i < 2; ++i) {
    const BatchSummary summary = run();
    EXPECT_EQ(summary.failed.size(), 1U) << i;
    EXPECT_TRUE(summary.known.empty()) << i;
  }
}

TEST_F(BatchTest, AfterMaxFailuresNoFurtherScanIsStarted) {
  for (int k = 0; k < 10; ++k)
    add("bad" + std::to_string(k), {{"do", "refuse"}, {"n", k}});
  BatchSettings settings = settings_of();
  settings.max_failures = 3;
  const BatchSummary first = run(settings);
  EXPECT_EQ(first.failed.size(), 3u);
  EXPECT_EQ(first.left, 7u);
  const BatchSummary second = run(settings);  // known failures do not count
  EXPECT_EQ(second.known.size(), 3u);
  EXPECT_EQ(second.failed.size(), 3u);
  EXPECT_EQ(second.left, 4u);
}

TEST_F(BatchTest, ASecondRunDoesNothingAndTheSameBytesAreFound) {
  add("a", {{"n", 1}});
  add("b", {{"n", 1}});  // the same bytes and parameters under another name
  add("c", {{"n", 1}}, "y");
  const BatchSummary first = run();
  EXPECT_EQ(first.made, 2u);
  EXPECT_EQ(first.found, 1u);
  EXPECT_EQ(run().unchanged, 3u);
  program_.digest_ = "another program";
  const BatchSummary other = run();
  EXPECT_EQ(other.made, 2u);
  program_.digest_ = "program";
  EXPECT_EQ(run().found, 3u);
}

TEST_F(BatchTest, AFileWhoseNameIsNotUtf8IsUnchangedInASecondRun) {
  const std::string file = folder_ /
                           "Sch\xe4"
                           "del.in";
  std::ofstream(file) << "x";
  collection_.scans.push_back({"a", {file}, "", "", json::object()});
  EXPECT_EQ(run().made, 1U);
  EXPECT_EQ(run().unchanged, 1U);
}

TEST_F(BatchTest, WhatTookPartIsKnownByNameSoThatExplainCanSayIt) {
  const std::string file = add("a", {{"n", 1}, {"m", 2}});
  run();
  BatchSettings settings = settings_of();
  const auto why = [&] { return Batch::plan(collection_, program_, settings)->explain("a")->why; };
  EXPECT_TRUE(why().empty());
  collection_.scans[0].parameters = {{"n", 3}, {"k", 4}};
  std::ofstream(file) << "z";
  program_.digest_ = "new";
  const std::vector<json> expected = {
      {{"cause", "program"}, {"old", "program"}, {"new", "new"}},
      {{"cause", "parameter"}, {"name", "k"}, {"old", nullptr}, {"new", 4}},
      {{"cause", "parameter"}, {"name", "m"}, {"old", 2}, {"new", nullptr}},
      {{"cause", "parameter"}, {"name", "n"}, {"old", 1}, {"new", 3}},
      {{"cause", "input"}, {"path", file}, {"what", "changed"}}};
  EXPECT_EQ(why(), expected);
}

TEST_F(BatchTest, ADamagedAssetIsFoundByVerifyAndMadeAgain) {
  add("a", {{"n", 1}});
  run();
  const fs::path asset = fs::canonical(folder_ / "store/assets/a.glb");
  const std::string good = text_in(asset);
  std::string bad = good;
  bad[bad.size() / 2] ^= 1;
  std::ofstream(asset, std::ios::binary) << bad;
  EXPECT_EQ(run().unchanged, 1u);  // its size is as it was
  EXPECT_EQ(run(true).made_again, Names{"a"});
  EXPECT_EQ(text_in(asset), good);
  EXPECT_TRUE(run(true).made_again.empty());
}

TEST_F(BatchTest, ShardsAreTheCollectionAndNoScanIsInTwo) {
  for (int k = 0; k < 10; ++k)
    add(std::string("s").append(std::to_string(k)), {{"n", k}});
  std::size_t total = 0;
  for (int shard = 0; shard < 3; ++shard) {
    BatchSettings settings = settings_of();
    settings.shard = std::pair{shard, 3};
    const auto summary = Batch::plan(collection_, program_, settings)->run();
    EXPECT_EQ(summary->made, summary->scans);
    total += summary->made;
  }
  EXPECT_EQ(total, 10u);
  EXPECT_EQ(run().unchanged, 10u);
}

TEST_F(BatchTest, WrongParametersRefuseTheCollectionBeforeAnythingIsDone) {
  add("a", {{"n", 1}});
  add("b", {{"wrong", 1}});
  const auto refused = Batch::plan(collection_, program_, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ExitCode::kUsage);
  EXPECT_EQ(refused.error().message, "scan b: wrong");
}

}  // namespace
}  // namespace trocar::farm
