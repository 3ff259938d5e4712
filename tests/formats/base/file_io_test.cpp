// SPDX-License-Identifier: Apache-2.0
#include "formats/base/files.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <string>

#include "formats/base/text.h"
#include "tests/support/take.h"
#include "tests/support/temporary_folder.h"

namespace trocar {
namespace {

namespace fs = std::filesystem;

class FileIo : public testing::Test {
 protected:
  std::size_t files() const { return temporary_.files(); }
  test::TemporaryFolder temporary_;
  fs::path folder_ = temporary_.path();
};

TEST_F(FileIo, TwoOutputsInOneFileAreRefusedHoweverItsPathIsSpelt) {
  const fs::path before = fs::current_path();
  fs::current_path(folder_);
  fs::create_directory("sub");
  for (const char* other : {"new.glb", "./new.glb", "sub/../new.glb", "sub/.././new.glb"}) {
    const OutputFile outputs[] = {{"-o", "new.glb"}, {"--report", other}};
    const auto checked = check_outputs(outputs, {});
    EXPECT_FALSE(checked) << other;
  }
  const OutputFile absolute[] = {{"-o", "new.glb"}, {"--report", folder_ / "new.glb"}};
  EXPECT_FALSE(check_outputs(absolute, {}));
  const OutputFile apart[] = {{"-o", "new.glb"}, {"--report", "sub/new.glb"}, {"--log", ""}};
  EXPECT_TRUE(check_outputs(apart, {}));
  fs::current_path(before);
}

TEST_F(FileIo, WritesAndReadsBack) {
  std::string text = "one two\n";
  text[3] = 0;
  ASSERT_TRUE(write_file_atomically(folder_ / "a", std::string_view(text)));
  ASSERT_TRUE(write_file_atomically(folder_ / "a", std::string_view("shorter")));
  const auto back = test::take(read_file(folder_ / "a"));
  EXPECT_EQ(std::string(back.begin(), back.end()), "shorter");
  EXPECT_EQ(files(), 1U);  // no temporary left
  struct stat status {};
  ASSERT_EQ(::stat((folder_ / "a").c_str(), &status), 0);
  const mode_t mask = ::umask(0);
  ::umask(mask);
  EXPECT_EQ(status.st_mode & 0777U, 0666U & ~mask);
}

TEST_F(FileIo, AFileThatIsReplacedPassesItsPermissionsOn) {
  const mode_t mask = ::umask(022);
  const auto mode_after = [&](const char* name, Readers readers) {
    EXPECT_TRUE(write_file_atomically(folder_ / name, std::string_view("x"), readers));
    return fs::status(folder_ / name).permissions();
  };
  EXPECT_EQ(mode_after("a", Readers::kByUmask), fs::perms(0644));
  EXPECT_EQ(mode_after("b", Readers::kOwner), fs::perms(0600));
  fs::permissions(folder_ / "a", fs::perms(0640));
  fs::permissions(folder_ / "b", fs::perms(0664));
  EXPECT_EQ(mode_after("a", Readers::kByUmask), fs::perms(0640));
  EXPECT_EQ(mode_after("b", Readers::kOwner), fs::perms(0664));
  // A link is replaced itself, so the permissions of its file do not count.
  fs::permissions(folder_ / "a", fs::perms(0666));
  fs::create_symlink(folder_ / "a", folder_ / "link");
  EXPECT_EQ(mode_after("link", Readers::kOwner), fs::perms(0600));
  ::umask(mask);
}

TEST_F(FileIo, WhatTheSystemLacksIsATemporaryReasonAndAWrongPathIsNone) {
  ASSERT_TRUE(write_file_atomically(folder_ / "a", std::string_view("x")));
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none{0, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &none), 0);
  const auto without_descriptor = read_file(folder_ / "a");
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &before), 0);
  ASSERT_FALSE(without_descriptor);
  EXPECT_TRUE(without_descriptor.error().is_temporary) << without_descriptor.error().message;
  for (const char* wrong : {"nowhere", ".", "a/b"})
    EXPECT_FALSE(read_file(folder_ / wrong).error().is_temporary) << wrong;
  for (const int error : {EIO, ESTALE, ENOMEM, ETIMEDOUT, ENFILE, EMFILE, EACCES, ENOTCONN})
    EXPECT_TRUE(is_of_circumstances(error)) << error;
}

TEST_F(FileIo, AFailureLeavesNothingBehind) {
  const auto nowhere = write_file_atomically(folder_ / "no" / "a", std::string_view("x"));
  ASSERT_FALSE(nowhere);
  EXPECT_EQ(nowhere.error().code, ExitCode::kUnwritable);
  fs::create_directory(folder_ / "folder");
  const auto on_folder = write_file_atomically(folder_ / "folder", std::string_view("x"));
  ASSERT_FALSE(on_folder);
  EXPECT_EQ(on_folder.error().code, ExitCode::kUnwritable);
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  EXPECT_FALSE(write_file_atomically(folder_ / "pipe", std::string_view("x")));
  EXPECT_TRUE(fs::is_fifo(folder_ / "pipe"));
  EXPECT_EQ(files(), 2U);
}

TEST_F(FileIo, RefusesWhatIsNotAFileOrTooLarge) {
  EXPECT_EQ(read_file(folder_).error().code, ExitCode::kRefused);
  EXPECT_EQ(read_file(folder_ / "absent").error().code, ExitCode::kRefused);
  ASSERT_TRUE(write_file_atomically(folder_ / "a", std::string_view("12345")));
  EXPECT_TRUE(read_file(folder_ / "a", 5));
  EXPECT_FALSE(read_file(folder_ / "a", 4));
  // Without waiting for its other end.
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  EXPECT_EQ(read_file(folder_ / "pipe").error().code, ExitCode::kRefused);
}

TEST(NearestName, FindsNearNamesOnly) {
  const std::vector<std::string> names = {"--threshold", "--tolerance", "--jobs"};
  EXPECT_EQ(nearest_name("--treshold", names), "--threshold");
  EXPECT_EQ(nearest_name("--job", names), "--jobs");
  EXPECT_EQ(nearest_name("--zebra", names), "");
  EXPECT_EQ(nearest_name(std::string(100'000, 'a'), names), "");
  EXPECT_EQ(did_you_mean("--tolerence", names), ", did you mean --tolerance?");
}

}  // namespace
}  // namespace trocar
