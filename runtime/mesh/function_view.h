// SPDX-License-Identifier: Apache-2.0
// A function as an argument, without allocation: what std::function_ref will be.
#pragma once

namespace trocar::runtime {

/// A reference to a function; it must outlive what it is given to. Empty by default.
template <typename Signature>
class FunctionView;
template <typename R, typename... Arguments>
class FunctionView<R(Arguments...)> {
 public:
  FunctionView() = default;
  template <typename F>
  FunctionView(const F& f) noexcept  // NOLINT(bugprone-forwarding-reference-overload)
      : f_(&f), call_([](const void* g, Arguments... arguments) noexcept -> R {
          return (*static_cast<const F*>(g))(arguments...);
        }) {}
  template <typename F>
  FunctionView(const F&&) = delete;  // would be gone before it is called
  explicit operator bool() const noexcept { return call_ != nullptr; }
  R operator()(Arguments... arguments) const noexcept { return call_(f_, arguments...); }

 private:
  const void* f_ = nullptr;
  R (*call_)(const void*, Arguments...) noexcept = nullptr;
};

}  // namespace trocar::runtime
