// SPDX-License-Identifier: Apache-2.0
// Boost.Beast with short names. Boost.Beast takes long to compile, so only files that handle
// sockets include this header.
#pragma once

#include <utility>  // must come before asio, which uses std::exchange without including it

#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

namespace trocar::runtime {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = net::ip::tcp;
using Request = http::request<http::string_body>;

}  // namespace trocar::runtime
