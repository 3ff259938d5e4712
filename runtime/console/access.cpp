// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/access.h"

#include <sodium.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <stdexcept>

namespace trocar::runtime {
namespace {

// `blank`: the character that stands for a blank.
std::optional<std::string> decoded(std::string_view text, char blank = ' ') {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i] == blank ? ' ' : text[i];
      continue;
    }
    const std::string_view digits = text.substr(i + 1, 2);
    unsigned char byte = 0;
    const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), byte, 16);
    if (read.ptr != digits.data() + 2) return std::nullopt;
    out += static_cast<char>(byte);
    i += 2;
  }
  return out;
}

constexpr std::size_t kTokenBytes = 16, kTokenDigits = 2 * kTokenBytes;

std::string random_token() {
  std::array<unsigned char, kTokenBytes> bytes{};
  ::randombytes_buf(bytes.data(), bytes.size());  // getrandom()
  std::array<char, kTokenDigits + 1> hex{};
  return ::sodium_bin2hex(hex.data(), hex.size(), bytes.data(), bytes.size());
}

bool is_equal(std::string_view token, const std::string& right) noexcept {
  return token.size() == right.size() &&
         ::sodium_memcmp(token.data(), right.data(), right.size()) == 0;
}

/// Returns true if the host consists of digits and dots, or of hexadecimal digits and
/// colons in brackets.
bool is_numerical(std::string_view host) noexcept {
  const bool v6 = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (v6) host = host.substr(1, host.size() - 2);
  return !host.empty() &&
         host.find_first_not_of(v6 ? "0123456789abcdef:" : "0123456789.") == std::string_view::npos;
}

constexpr double kMessagesPerSecond = 125, kMaxAtOnce = 4;
constexpr auto kSilent = std::chrono::seconds(1);

}  // namespace

std::optional<RequestTarget> RequestTarget::parse(std::string_view text) {
  constexpr std::size_t kMaxParameters = 8;
  RequestTarget target;
  const std::size_t question = text.find('?');
  const auto path = decoded(text.substr(0, question));
  if (!path || !path->starts_with('/')) return std::nullopt;
  target.path = *path;
  std::string_view rest = question == std::string_view::npos ? "" : text.substr(question + 1);
  while (!rest.empty()) {
    const std::string_view one = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(rest.size(), one.size() + 1));
    const std::size_t equals = one.find('=');
    if (equals == std::string_view::npos || target.parameters.size() == kMaxParameters)
      return std::nullopt;
    const auto name = decoded(one.substr(0, equals), '+'),
               value = decoded(one.substr(equals + 1), '+');
    if (!name || !value || !target.parameters.emplace(*name, *value).second) return std::nullopt;
  }
  return target;
}

std::string RequestTarget::parameter(const char* name) const {
  const auto found = parameters.find(name);
  return found == parameters.end() ? "" : found->second;
}

const char* to_string(Role role) noexcept {
  return role == Role::kOperator ? "operator" : role == Role::kView ? "view" : "none";
}

Tokens::Tokens() {
  if (::sodium_init() < 0) throw std::runtime_error("libsodium cannot be initialised");
  operator_ = random_token();
  view_ = random_token();
}

Role Tokens::role_of(std::string_view token) const noexcept {
  const bool is_operator = is_equal(token, operator_), is_view = is_equal(token, view_);
  if (is_operator) return Role::kOperator;
  return is_view ? Role::kView : Role::kNone;
}

Role Tokens::role_of_header(std::string_view authorization) const noexcept {
  constexpr std::string_view kScheme = "Bearer ";
  return authorization.starts_with(kScheme) ? role_of(authorization.substr(kScheme.size()))
                                            : Role::kNone;
}

HostNames::HostNames(const std::string& listen_address, std::uint16_t port, std::string public_url)
    : port_(std::string(":").append(std::to_string(port))),
      public_url_(std::move(public_url)),
      public_host_(public_url_.substr(public_url_.empty() ? 0 : public_url_.find("//") + 2)),
      any_address_(listen_address == "0.0.0.0" || listen_address == "::") {
  names_ = {"127.0.0.1", "localhost", "[::1]"};
  const bool is_v6 = listen_address.find(':') != std::string::npos;
  names_.push_back(is_v6 ? std::string("[").append(listen_address).append("]") : listen_address);
}

bool HostNames::is_host(std::string_view host) const {
  if (!public_host_.empty() && host == public_host_) return true;
  if (host.ends_with(port_))
    host.remove_suffix(port_.size());
  else if (port_ != ":80")
    return false;
  return std::find(names_.begin(), names_.end(), host) != names_.end() ||
         (any_address_ && is_numerical(host));
}

bool HostNames::is_origin(std::string_view origin, std::string_view host) const {
  constexpr std::string_view kScheme = "http://";
  if (!public_url_.empty() && origin == public_url_) return host == public_host_;
  return origin.starts_with(kScheme) && origin.substr(kScheme.size()) == host;
}

Result<std::string> public_url_of(std::string_view text) {
  constexpr std::size_t kMaxBytes = 300;
  std::string url(text.substr(0, kMaxBytes));
  std::transform(url.begin(), url.end(), url.begin(), [](char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  if (url.ends_with('/')) url.pop_back();
  const std::size_t scheme = url.starts_with("http://") ? 7 : url.starts_with("https://") ? 8 : 0;
  const bool is_authority = scheme > 0 && url.size() > scheme && text.size() <= kMaxBytes &&
                            url.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789.-:[]",
                                                  scheme) == std::string::npos;
  if (!is_authority)
    return usage("--public-url " + std::string(text.substr(0, kMaxBytes)) +
                 ": must be http://HOST[:PORT] or https://HOST[:PORT]");
  return url;
}

bool is_file_name(std::string_view name) noexcept {
  constexpr std::size_t kMaxBytes = 512, kMaxParts = 8;
  if (name.empty() || name.size() > kMaxBytes) return false;
  std::size_t parts = 1;
  bool at_start = true;
  for (const char c : name) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f || c == '\\') return false;
    if (at_start && (c == '.' || c == '/')) return false;
    at_start = c == '/';
    parts += at_start ? 1 : 0;
  }
  return !at_start && parts <= kMaxParts;
}

const char* to_string(HandShare share) noexcept {
  constexpr std::array<const char*, 3> kNames = {"yours", "other", "free"};
  return kNames[static_cast<std::size_t>(share)];
}

bool HandHolder::move(Client client, std::uint64_t number, Clock::time_point now) noexcept {
  if (holder_ != nullptr && holder_ != client) return false;
  if (holder_ == client && number <= number_) return false;
  if (holder_ == nullptr) holder_ = client;
  number_ = number;
  heard_at_ = now;
  const double passed_s = std::chrono::duration<double>(now - credited_at_).count();
  credit_ = std::min(kMaxAtOnce, credit_ + passed_s * kMessagesPerSecond);
  credited_at_ = now;
  if (credit_ < 1) return false;
  credit_ -= 1;
  return true;
}

bool HandHolder::let_go(Client client) noexcept {
  if (holder_ != client) return false;
  holder_ = nullptr;
  return true;
}

bool HandHolder::lose_silent(Clock::time_point now) noexcept {
  if (holder_ == nullptr || now - heard_at_ < kSilent) return false;
  holder_ = nullptr;
  return true;
}

}  // namespace trocar::runtime
