// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/link/link_key.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "formats/session/device_protocol.h"
#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

namespace fs = std::filesystem;

class KeyFile : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(start_link()); }
  void write(const std::string& text) { std::ofstream(file_, std::ios::binary) << text; }
  test::TemporaryFolder temporary_;
  fs::path folder_ = temporary_.path();
  fs::path file_ = folder_ / "key";
};

TEST_F(KeyFile, IsCreatedOnceWithMode0600AndReadBack) {
  const auto made = make_link_key(file_);
  ASSERT_TRUE(made) << made.error().message;
  struct stat status {};
  ASSERT_EQ(::stat(file_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600U);
  const auto read = read_link_key(file_);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->bytes, made->bytes);
  const auto again = make_link_key(file_);
  ASSERT_FALSE(again) << "an existing key was replaced";
  EXPECT_EQ(again.error().code, ExitCode::kUnwritable);
  EXPECT_EQ(read_link_key(file_)->bytes, made->bytes);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1) << "a temporary file is left";
  EXPECT_FALSE(make_link_key(folder_ / "no" / "such"));
}

TEST_F(KeyFile, WrongModesAndContentsAreRefused) {
  EXPECT_FALSE(read_link_key(file_));
  EXPECT_FALSE(read_link_key(folder_));
  EXPECT_FALSE(read_link_key("/dev/zero"));
  const std::string digits(64, 'a');
  write(digits + "\n");
  for (const int mode : {0640, 0604, 0620, 0660, 0644}) {
    ::chmod(file_.c_str(), static_cast<mode_t>(mode));
    const auto read = read_link_key(file_);
    ASSERT_FALSE(read) << std::oct << mode;
    EXPECT_NE(read.error().message.find("chmod 600"), std::string::npos);
  }
  for (const int mode : {0600, 0400}) {
    ::chmod(file_.c_str(), static_cast<mode_t>(mode));
    EXPECT_TRUE(read_link_key(file_)) << std::oct << mode;
  }
  ::chmod(file_.c_str(), 0600);
  for (const std::string& bad :
       {std::string(), digits.substr(1), digits + "a", digits + "\n\n", digits.substr(1) + "g",
        digits.substr(1) + "\n", digits + "\r\n"}) {
    write(bad);
    EXPECT_FALSE(read_link_key(file_)) << bad;
  }
}

}  // namespace
}  // namespace trocar::runtime
