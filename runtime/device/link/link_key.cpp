// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/link/link_key.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <charconv>

namespace trocar::runtime {
namespace {

constexpr std::size_t kDigits = 2 * kLinkKeyBytes;

/// Reads the digits of a key. Returns false if one of them is not hexadecimal.
bool read_digits(const char* digits, LinkKey& key) noexcept {
  for (std::uint8_t& byte : key.bytes) {
    const auto [end, error] = std::from_chars(digits, digits + 2, byte, 16);
    if (error != std::errc{} || end != digits + 2) return false;
    digits = end;
  }
  return true;
}

/// Reads an opened key file. Returns the reason why it is refused, or an empty string. `is_open` is
/// set if other users have access to the file.
std::string read_guarded(int fd, std::array<char, kDigits + 2>& text, std::size_t& bytes,
                         bool& is_open) {
  struct stat status {};
  if (::fstat(fd, &status) != 0) return system_message(errno);
  if (!S_ISREG(status.st_mode)) return "not a regular file";
  if (status.st_uid != ::geteuid()) return "owned by another user";
  is_open = (status.st_mode & 077) != 0;
  const ssize_t got = ::read(fd, text.data(), text.size());
  if (got < 0) return system_message(errno);
  bytes = static_cast<std::size_t>(got);
  return {};
}

}  // namespace

Result<LinkKey> read_link_key(const std::filesystem::path& file) {
  const FileDescriptor opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (opened.get() < 0) return refused(file.string() + ": " + system_message(errno));
  std::array<char, kDigits + 2> text{};
  std::size_t bytes = 0;
  bool is_open = false;
  const std::string wrong = read_guarded(opened.get(), text, bytes, is_open);
  if (!wrong.empty()) return refused(file.string() + ": " + wrong);

  LinkKey key;
  const bool ends = bytes == kDigits || (bytes == kDigits + 1 && text[kDigits] == '\n');
  if (!ends || !read_digits(text.data(), key))
    return refused(file.string() + ": not a key: it must have 64 hexadecimal digits");
  // This check comes last, so that no user is asked to change the mode of a file that is not a key.
  if (is_open) return refused(file.string() + ": other users have access to it; chmod 600 it");
  return key;
}

Result<LinkKey> make_link_key(const std::filesystem::path& file) {
  const LinkKey key = random_link_key();
  std::string text;
  for (const std::uint8_t byte : key.bytes) {
    text += "0123456789abcdef"[byte >> 4];
    text += "0123456789abcdef"[byte & 15];
  }
  text += '\n';
  // The key must never be readable by others. It is written to a temporary file of mode 0600, which
  // is renamed when it is complete, and only if no file has the final name.
  std::string temporary = file.string() + ".XXXXXX";
  const int fd = ::mkostemp(temporary.data(), O_CLOEXEC);
  if (fd < 0) return unwritable(file.string() + ": " + system_message(errno));
  const bool written = ::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
                       ::fsync(fd) == 0;
  const bool linked = written && ::link(temporary.c_str(), file.c_str()) == 0;
  const int error = errno;
  ::close(fd);
  ::unlink(temporary.c_str());
  if (!linked) return unwritable(file.string() + ": " + system_message(error));
  return key;
}

}  // namespace trocar::runtime
