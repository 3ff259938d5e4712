// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/product.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>

#include "pipeline/farm/batch_run.h"
#include "pipeline/farm/command.h"
#include "tests/support/temporary_folder.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;

TEST(Product, NamesAndKindsAreOneToOne) {
  for (const ProductKind kind : kProductKinds)
    EXPECT_EQ(product_kind(product_name(kind)), kind);
  EXPECT_FALSE(product_kind("asset"));
  EXPECT_FALSE(product_kind(""));
}

class CommandTest : public testing::Test {
 protected:
  Result<void> shell(const std::string& script) {
    return run_command(
        {{"/bin/sh", "-c", script}, folder_.path(), folder_ / "out", folder_ / "errors"}, &stop_);
  }
  std::string text(const char* name) const {
    std::ifstream in(folder_ / name);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  test::TemporaryFolder folder_;
  std::atomic<bool> stop_ = false;
};

TEST_F(CommandTest, RunsInItsFolderWithItsOutputInFiles) {
  ASSERT_TRUE(shell("pwd; echo warning >&2"));
  EXPECT_EQ(text("out"), fs::canonical(folder_.path()).string() + "\n");
  EXPECT_EQ(text("errors"), "warning\n");
}

TEST_F(CommandTest, ItsEnvironmentIsThatOfThisProcessAndAsksForTheExitCode) {
  ASSERT_TRUE(shell(std::string("[ -n \"$PATH\" ] && echo \"$") + kExitForNowVariable + "\""));
  EXPECT_EQ(text("out"), "1\n");
}

TEST_F(CommandTest, AnErrorHasTheLastLineAndTheCodeOfTheProgram) {
  const auto of = [&](const std::string& script) { return shell(script).error(); };
  const Error refusal = of("echo note >&2; echo 'sh: scan.nii: no bone' >&2; exit 3");
  EXPECT_EQ(refusal.message, "scan.nii: no bone");
  EXPECT_EQ(refusal.code, ExitCode::kRefused);
  EXPECT_FALSE(refusal.is_temporary);
  EXPECT_EQ(of("echo wrong >&2; exit 2").code, ExitCode::kUsage);
  const Error for_now = of("echo 'sh: scan.nii: no space' >&2; exit 75");
  EXPECT_EQ(for_now.message, "scan.nii: no space");
  EXPECT_EQ(for_now.code, ExitCode::kRefused);
  EXPECT_TRUE(for_now.is_temporary);
  const Error full = of("echo full >&2; exit 4");
  EXPECT_EQ(full.code, ExitCode::kUnwritable);
  EXPECT_TRUE(full.is_temporary);
  const Error silent = of("exit 7");
  EXPECT_EQ(silent.message, "it ended with exit code 7");
  EXPECT_EQ(silent.code, ExitCode::kBug);
  EXPECT_TRUE(silent.is_temporary);
  const Error killed = of("kill -9 $$");
  EXPECT_EQ(killed.message, "it was killed by signal 9");
  EXPECT_TRUE(killed.is_temporary);
}

TEST_F(CommandTest, AProgramThatIsNotThereIsAnError) {
  const auto done = run_command(
      {{"/nowhere/program"}, folder_.path(), folder_ / "out", folder_ / "errors"}, nullptr);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().message, "it ended with exit code 127");
}

TEST_F(CommandTest, StopKillsIt) {
  std::thread stopper([this] {
    while (!fs::exists(folder_ / "started"))
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    stop_ = true;
  });
  const auto done = shell("touch started; exec sleep 600");
  stopper.join();
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().message, "it was killed by signal 9");
}

// Accepts all parameters of scans, and makes none.
class AnyParameters : public ScanProgram {
 public:
  Result<Parameters> parameters(const nlohmann::json& given) const override {
    return Parameters{given, {}};
  }
  bool opens_first(const std::vector<fs::path>&, const Parameters&) const override { return false; }
  Result<std::unique_ptr<OpenedScan>> open(const nlohmann::json&, const std::vector<fs::path>&,
                                           const std::string&, int) const override {
    return refused("makes no scan");
  }
};

// The program of a product is asked once for each set of options, whatever their values.
TEST(ProductOptions, ThatItsProgramRefusesRefuseTheCollectionBeforeAnythingIsDone) {
  const test::TemporaryFolder folder;
  ProductPrograms programs;
  programs.run = (folder / "run").string();
  std::ofstream(programs.run) << "#!/bin/sh\necho \"$@\" >> " << (folder / "asked").string()
                              << "\ncase \"$*\" in *--wrong*)\n"
                                 "  echo 'run: --wrong: no such option' >&2; exit 2 ;;\nesac\n"
                                 "exit 3\n";
  fs::permissions(programs.run, fs::perms::owner_all);
  Collection collection;
  for (const char* name : {"a", "b"}) {
    CollectionScan scan{name, {"scan.in"}, "", ""};
    scan.products = {{ProductKind::kScene, nlohmann::json{{"entry", name}}},
                     {ProductKind::kCheck, nlohmann::json{{"strict", true}}}};
    collection.scans.push_back(std::move(scan));
  }
  BatchSettings settings;
  settings.store = folder / "store";
  const AnyParameters program;
  EXPECT_TRUE(Batch::plan(collection, program, programs, settings));
  std::ifstream asked(folder / "asked");
  const std::string lines(std::istreambuf_iterator<char>(asked), {});
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 2) << lines;
  EXPECT_NE(lines.find("--new-scene"), std::string::npos) << lines;
  EXPECT_NE(lines.find("--check --strict"), std::string::npos) << lines;

  collection.scans[1].products[0].parameters = nlohmann::json{{"wrong", "yes"}};
  const auto refused = Batch::plan(collection, program, programs, settings);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ExitCode::kUsage);
  EXPECT_EQ(refused.error().message, "scan b, product scene: --wrong: no such option");
  EXPECT_FALSE(fs::exists(folder / "store"));
}

// A defect of one scan's CT is found when that scan is made. It says nothing about the options.
TEST(ProductOptions, AreCheckedWithoutTheCtOfALabelMap) {
  const test::TemporaryFolder folder;
  ProductPrograms programs;
  programs.mesh = (folder / "mesh").string();
  std::ofstream(programs.mesh) << "#!/bin/sh\necho \"$@\" >> " << (folder / "asked").string()
                               << "\ncase \"$*\" in *broken*) exit 2 ;; esac\nexit 3\n";
  fs::permissions(programs.mesh, fs::perms::owner_all);
  Collection collection;
  CollectionScan scan{"a", {"scan.in"}, "", ""};
  scan.parameters = {{"labels", "1"}, {"hu", "broken.nii"}};
  scan.products = {{ProductKind::kPreview, nlohmann::json{{"count", 6}}}};
  collection.scans.push_back(std::move(scan));
  BatchSettings settings;
  settings.store = folder / "store";
  const AnyParameters program;
  const auto planned = Batch::plan(collection, program, programs, settings);
  EXPECT_TRUE(planned) << planned.error().message;
  std::ifstream asked(folder / "asked");
  const std::string words(std::istreambuf_iterator<char>(asked), {});
  EXPECT_NE(words.find("--count=6"), std::string::npos) << words;
}

}  // namespace
}  // namespace trocar::farm
