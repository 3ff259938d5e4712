// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/igtl/igtl_address.h"

#include <boost/asio/ip/address.hpp>
#include <charconv>

namespace trocar::runtime {

Result<IgtlAddress> parse_igtl_address(std::string_view text) {
  const Error wrong = usage("--igtl " + std::string(text) +
                            ": must be PORT or ADDRESS:PORT with a numerical address, for instance "
                            "18944 or 127.0.0.1:18944");
  IgtlAddress out;
  std::string_view port = text;
  if (const std::size_t colon = text.rfind(':'); colon != std::string_view::npos) {
    port = text.substr(colon + 1);
    std::string_view host = text.substr(0, colon);
    const bool has_brackets = host.size() > 2 && host.front() == '[' && host.back() == ']';
    if (has_brackets) host = host.substr(1, host.size() - 2);
    boost::system::error_code error;
    const boost::asio::ip::address address =
        boost::asio::ip::make_address(std::string(host), error);
    if (error || address.is_v6() != has_brackets) return wrong;
    out.address = address.to_string();
  }
  const auto [end, failed] = std::from_chars(port.data(), port.data() + port.size(), out.port);
  if (failed != std::errc{} || end != port.data() + port.size()) return wrong;
  return out;
}

}  // namespace trocar::runtime
