// SPDX-License-Identifier: GPL-3.0-or-later
// Against zlib, on whole, joined, truncated and damaged files; and what ISA-L's calls leave in the
// processor.
#include "pipeline/read/volume_file.h"

#include <gtest/gtest.h>

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>
#include <zlib.h>
#include <csignal>
#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "tests/support/take.h"
#include "tests/support/temporary_folder.h"

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#endif

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

std::string packed(const std::string& text, int level = 6) {
  z_stream stream{};
  deflateInit2(&stream, level, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  std::string out(deflateBound(&stream, text.size()) + 64, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

/// Half noise, half repeats, as voxels.
std::string voxels(std::size_t size, unsigned seed) {
  std::mt19937 random(seed);
  std::string out(size, '\0');
  for (std::size_t i = 0; i < size; ++i)
    out[i] = static_cast<char>(i % 2 == 0 ? random() % 256 : i / 1000);
  return out;
}

fs::path written(const fs::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
  return file;
}

/// None: damaged or cut.
std::optional<std::string> by_zlib(const fs::path& file) {
  const gzFile in = gzopen(file.c_str(), "rb");
  std::string out, block(5000, '\0');
  int n = 0;
  while ((n = gzread(in, block.data(), 5000)) > 0)
    out.append(block.data(), static_cast<std::size_t>(n));
  if (gzclose_r(in) != Z_OK || n < 0) return std::nullopt;
  return out;
}

std::optional<std::string> by_reader(const fs::path& file, std::size_t at_once) {
  const int descriptor = ::open(file.c_str(), O_RDONLY);
  EXPECT_TRUE(GzipReader::is_gzip(descriptor));
  GzipReader reader(descriptor, file.string());
  std::string out, block(at_once, '\0');
  std::optional<std::string> found;
  for (;;) {
    const auto n = reader.read(block);
    if (!n) {
      const std::string what =
          reader.is_truncated() ? ": truncated: its gzip data end early" : ": damaged gzip";
      EXPECT_TRUE(n.error().message.starts_with(file.string() + what)) << n.error().message;
      EXPECT_EQ(n.error().code, ExitCode::kRefused);
      break;
    }
    out.append(block.data(), *n);
    if (*n == 0) {
      found = out;
      break;
    }
  }
  ::close(descriptor);
  return found;
}

TEST(GzipReader, UnpacksAsZlibForAnySizeAtOnce) {
  const test::TemporaryFolder folder;
  for (const std::size_t size : {0U, 1U, 1000U, 400'000U}) {
    for (const int level : {0, 1, 9}) {
      const std::string text = voxels(size, 1);
      const fs::path file = written(folder / "a.gz", packed(text, level));
      for (const std::size_t at_once : {1U, 7U, 4096U, 1U << 18U}) {
        if (at_once == 1 && size > 1000) continue;
        EXPECT_EQ(by_reader(file, at_once), text) << size << ' ' << level << ' ' << at_once;
      }
    }
  }
}

TEST(GzipReader, UnpacksMembersOneAfterTheOther) {
  const test::TemporaryFolder folder;
  std::string bytes, text;
  for (unsigned k = 0; k < 50; ++k) {
    const std::string part = voxels(k * 977 % 9000, k);
    bytes += packed(part);
    text += part;
  }
  EXPECT_EQ(by_reader(written(folder / "a.gz", bytes), 3000), text);
  // Zeros behind the last member are left out, as on tapes. Other bytes are damage.
  EXPECT_EQ(by_reader(written(folder / "b.gz", bytes + std::string(300'000, '\0')), 3000), text);
  EXPECT_EQ(by_reader(written(folder / "b.gz", bytes + packed("")), 3000), text);
  const std::string first = packed(voxels(3000, 1)), second = packed(voxels(3000, 2));
  EXPECT_EQ(by_reader(written(folder / "b.gz", first.substr(0, first.size() - 8) + second), 3000),
            std::nullopt);
  EXPECT_EQ(by_reader(written(folder / "b.gz", first + second.substr(0, second.size() - 8)), 3000),
            std::nullopt);
  for (const char* more : {"\x1f", "\x1f\x8b", "garbage"})
    EXPECT_EQ(by_reader(written(folder / "c.gz", bytes + more), 3000), std::nullopt);
  EXPECT_EQ(by_reader(written(folder / "d.gz", bytes + std::string(300'000, '\0') + "x"), 3000),
            std::nullopt);
}

TEST(GzipReader, AMemberWithoutItsTrailerIsTruncated) {
  const test::TemporaryFolder folder;
  const std::string text = voxels(3000, 3), whole = packed(text);
  for (std::size_t left_out = 1; left_out <= 30; ++left_out) {
    const fs::path cut = written(folder / "cut.gz", whole.substr(0, whole.size() - left_out));
    for (const std::size_t at_once : {1U, 3000U, 5000U})
      EXPECT_EQ(by_reader(cut, at_once), std::nullopt) << left_out << ' ' << at_once;
    const auto size = static_cast<std::int64_t>(text.size());
    for (const bool behind : {false, true}) {
      const auto opened = VolumeFile::open(cut, 0, size, behind);
      const Error error = opened ? opened->finish().error() : opened.error();
      EXPECT_NE(error.message.find("truncated"), std::string::npos) << error.message;
    }
  }
  // Also behind the bytes that are wanted, up to those that the header declares.
  const fs::path cut = written(folder / "cut.gz", whole.substr(0, whole.size() - 8));
  EXPECT_TRUE(VolumeFile::open(cut, 0, 1000));
  EXPECT_FALSE(VolumeFile::open(cut, 0, 1000, false, 3000));
}

TEST(GzipReader, SaysOfDamagedFilesWhatZlibSays) {
  const test::TemporaryFolder folder;
  const std::string text = voxels(3000, 3), whole = packed(text);
  int damaged = 0;
  for (std::size_t i = 2; i < whole.size(); ++i) {
    const fs::path cut = written(folder / "cut.gz", whole.substr(0, i));
    const auto expected = by_zlib(cut), found = by_reader(cut, 700);
    EXPECT_EQ(found, std::nullopt) << "cut at " << i;
    EXPECT_EQ(expected, std::nullopt) << "cut at " << i;

    std::string wrong = whole;
    wrong[i] = static_cast<char>(wrong[i] ^ (1 << (i % 8)));
    const fs::path bad = written(folder / "bad.gz", wrong);
    const auto as_zlib = by_zlib(bad), as_reader = by_reader(bad, 700);
    if (!as_reader) ++damaged;
    // Nothing that zlib finds damaged is taken as whole.
    if (!as_zlib) {
      EXPECT_TRUE(!as_reader || as_reader->size() < text.size()) << "bit of byte " << i;
    }
    if (as_reader && as_reader->size() == text.size()) {
      EXPECT_EQ(*as_reader, text) << i;
    }
  }
  EXPECT_GT(damaged, 1000);
}

// Another try may succeed once there is space, so a batch must not keep the failure.
TEST(VolumeFile, AFullFolderForTemporaryFilesIsATemporaryError) {
  auto file = test::take(VolumeFile::temporary("scan.nii"));
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small = {1000, before.rlim_max};  // as if the disk were full after 1000 bytes
  const auto signal_before = ::signal(SIGXFSZ, SIG_IGN);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const auto done = file.append(std::vector<char>(2000), "scan.nii");
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  ::signal(SIGXFSZ, signal_before);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ExitCode::kRefused);
  EXPECT_TRUE(done.error().is_temporary);
  EXPECT_NE(done.error().message.find("no space"), std::string::npos) << done.error().message;
}

TEST(VolumeFile, UnpackedBehindGivesTheSameBytesAndErrors) {
  const test::TemporaryFolder folder;
  const std::string text = voxels(3'000'000, 5), bytes = packed(text);
  const auto size = static_cast<std::int64_t>(text.size()) - 352;
  const fs::path good = written(folder / "good.gz", bytes);
  std::string flipped = bytes;
  flipped[bytes.size() - 6] ^= 1;  // of the checksum
  const fs::path wrong = written(folder / "wrong.gz", flipped);
  const fs::path cut = written(folder / "cut.gz", bytes.substr(0, bytes.size() / 2));
  for (const bool behind : {false, true}) {
    const auto opened = test::take(VolumeFile::open(good, 352, size, behind));
    for (const std::int64_t at : {std::int64_t{0}, size - 1000, size / 2}) {
      std::string block(1000, '\0');
      ASSERT_TRUE(opened.read(at, block, "slice"));
      EXPECT_EQ(block, text.substr(static_cast<std::size_t>(at) + 352, 1000));
    }
    EXPECT_TRUE(opened.finish());
    std::string beyond(1000, '\0');
    EXPECT_FALSE(opened.read(size - 10, beyond, "slice"));
  }
  EXPECT_EQ(VolumeFile::open(wrong, 352, size).error().message, wrong.string() + ": damaged gzip");
  const auto opened = test::take(VolumeFile::open(wrong, 352, size, true));
  std::string block(1000, '\0');
  EXPECT_TRUE(opened.read(0, block, "slice 0"));
  EXPECT_EQ(opened.finish().error().message, wrong.string() + ": damaged gzip");

  const std::string said = VolumeFile::open(cut, 352, size).error().message;
  EXPECT_NE(said.find("truncated: its header declares voxels up to byte 3000000"),
            std::string::npos);
  const auto half = test::take(VolumeFile::open(cut, 352, size, true));
  EXPECT_TRUE(half.read(0, block, "slice 0"));
  EXPECT_EQ(half.read(size - 1000, block, "slice 9").error().message, said);
  EXPECT_EQ(half.finish().error().message, said);
  // Not read to its end.
  EXPECT_TRUE(VolumeFile::open(good, 352, size, true));
}

std::vector<std::uint8_t> bytes_of(std::size_t size) {
  std::mt19937 random(1);
  std::vector<std::uint8_t> out(size);
  for (std::size_t i = 0; i < size; ++i)
    out[i] = i < size / 2 ? static_cast<std::uint8_t>(random()) : out[i - size / 2];
  return out;
}

#if defined(__x86_64__)
bool tells_what_is_in_use() {
  unsigned a = 0, b = 0, c = 0, d = 0;
  return __get_cpuid_count(0xd, 1, &a, &b, &c, &d) != 0 && (a & 4U) != 0;
}
// The upper halves of the registers that all vector code uses: bit 2 of AVX, bit 6 of AVX-512.
[[gnu::target("xsave")]] std::uint64_t upper_halves_in_use() {
  return _xgetbv(1) & 0x44U;
}
#else
bool tells_what_is_in_use() {
  return false;
}
std::uint64_t upper_halves_in_use() {
  return 0;
}
#endif

// SSE code that follows would be slowed down.
TEST(Isal, LeavesNoUpperHalvesOfVectorRegistersInUse) {
  if (!tells_what_is_in_use()) GTEST_SKIP() << "this processor does not tell";
  const std::vector<std::uint8_t> plain = bytes_of(1'000'000);
  std::vector<std::uint8_t> packed(compressBound(plain.size()));
  uLongf size = packed.size();
  ASSERT_EQ(compress(packed.data(), &size, plain.data(), plain.size()), Z_OK);
  const auto state = std::make_unique<inflate_state>();
  isal_inflate_init(state.get());
  state->crc_flag = ISAL_ZLIB;
  std::vector<std::uint8_t> back(plain.size());
  state->next_in = packed.data();
  state->avail_in = static_cast<std::uint32_t>(size);
  state->next_out = back.data();
  state->avail_out = static_cast<std::uint32_t>(back.size());
  const int inflated = inflate_on(*state);
  const std::uint64_t after_inflate = upper_halves_in_use();
  const std::uint32_t checksum = gzip_checksum(plain);
  const std::uint64_t after_checksum = upper_halves_in_use();
  EXPECT_EQ(inflated, ISAL_DECOMP_OK);
  EXPECT_EQ(back, plain);
  EXPECT_EQ(checksum, crc32(0, plain.data(), static_cast<uInt>(plain.size())));
  EXPECT_EQ(after_inflate, 0U);
  EXPECT_EQ(after_checksum, 0U);
}

}  // namespace
}  // namespace trocar::pipeline
