// SPDX-License-Identifier: Apache-2.0
// Passes a function as an argument without allocation, like std::function_ref of C++26.
#pragma once

namespace trocar::runtime {

/// A reference to a function. The function must outlive the reference. By default the reference is
/// empty; an empty reference must not be called.
template <typename Signature>
class FunctionRef;
template <typename R, typename... Arguments>
class FunctionRef<R(Arguments...)> {
 public:
  FunctionRef() = default;
  template <typename F>
  FunctionRef(const F& f) noexcept  // NOLINT(bugprone-forwarding-reference-overload)
      : f_(&f), call_([](const void* g, Arguments... arguments) noexcept -> R {
          return (*static_cast<const F*>(g))(arguments...);
        }) {}
  template <typename F>
  FunctionRef(const F&&) = delete;  // a temporary would be destroyed before the call
  explicit operator bool() const noexcept { return call_ != nullptr; }
  R operator()(Arguments... arguments) const noexcept { return call_(f_, arguments...); }

 private:
  const void* f_ = nullptr;
  R (*call_)(const void*, Arguments...) noexcept = nullptr;
};

}  // namespace trocar::runtime
