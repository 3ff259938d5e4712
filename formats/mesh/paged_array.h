// SPDX-License-Identifier: Apache-2.0
// An array whose copies share their elements. The elements are stored in pages (blocks of 256
// elements). A copy of the array refers to the same pages, and the first write to a shared page
// gives the writer a page of its own. The remesher (runtime/session/remesher.h) keeps two copies of
// each sheet. Because of the shared pages, both together take little more memory than one, however
// large the sheet is.
//
// Contract:
//  1. A write to an array never changes what another array contains. Reading through a mutable
//     array counts as a write and can copy a page; reading through a const reference does not.
//  2. Threads may read an array while another thread writes to a copy of this array. While a thread
//     writes to an array, other threads may not read this same array.
//  3. A write does not allocate if its page is not shared, or if spare pages are left
//     (reserve_pages()).
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

namespace trocar {

template <typename T>
class PagedArray {
  static constexpr std::size_t kShift = 8, kPage = std::size_t{1} << kShift, kMask = kPage - 1;
  struct Page {
    std::array<T, kPage> element{};
    std::atomic<std::uint32_t> owners{1};
  };

 public:
  class Iterator {
   public:
    using iterator_category = std::forward_iterator_tag;
    using value_type = T;
    using difference_type = std::ptrdiff_t;
    using pointer = const T*;
    using reference = const T&;

    Iterator() = default;
    Iterator(const PagedArray& array, std::size_t at) : array_(&array), at_(at) {}
    const T& operator*() const noexcept { return (*array_)[at_]; }
    const T* operator->() const noexcept { return &(*array_)[at_]; }
    Iterator& operator++() noexcept {
      ++at_;
      return *this;
    }
    Iterator operator++(int) noexcept {
      const Iterator before = *this;
      ++at_;
      return before;
    }
    bool operator==(const Iterator& other) const noexcept { return at_ == other.at_; }

   private:
    const PagedArray* array_ = nullptr;
    std::size_t at_ = 0;
  };

  PagedArray() = default;
  explicit PagedArray(std::size_t size, const T& value = {}) { resize(size, value); }
  PagedArray(const std::vector<T>& from) {  // NOLINT(google-explicit-constructor)
    resize(from.size());
    for (std::size_t i = 0; i < from.size(); ++i)
      (*this)[i] = from[i];
  }
  /// Shares the pages of `other`. O(pages).
  PagedArray(const PagedArray& other) : pages_(other.pages_), size_(other.size_) {
    for (Page* page : pages_)
      page->owners.fetch_add(1, std::memory_order_relaxed);
  }
  PagedArray(PagedArray&& other) noexcept { swap(other); }
  PagedArray& operator=(const PagedArray& other) {
    PagedArray copy(other);
    swap(copy);
    return *this;
  }
  PagedArray& operator=(PagedArray&& other) noexcept {
    PagedArray moved(std::move(other));
    swap(moved);
    return *this;
  }
  ~PagedArray() {
    for (Page* page : pages_)
      release(page);
    for (Page* page : spare_)
      release(page);
  }

  std::size_t size() const noexcept { return size_; }
  bool empty() const noexcept { return size_ == 0; }
  const T& operator[](std::size_t i) const noexcept {
    return pages_[i >> kShift]->element[i & kMask];
  }
  T& operator[](std::size_t i) noexcept {
    Page*& page = pages_[i >> kShift];
    if (is_shared(page)) make_own(page);
    return page->element[i & kMask];
  }
  Iterator begin() const noexcept { return {*this, 0}; }
  Iterator end() const noexcept { return {*this, size_}; }

  /// Changes the size; new elements have this value. Allocates. All pages that contain only new
  /// elements are stored as one shared page until they are written to.
  void resize(std::size_t size, const T& value = {}) {
    const std::size_t pages = (size + kPage - 1) >> kShift;
    while (pages_.size() > pages) {
      release(pages_.back());
      pages_.pop_back();
    }
    for (std::size_t i = size_; i < std::min(size, pages_.size() << kShift); ++i)
      (*this)[i] = value;
    if (pages_.size() < pages) {  // new pages share one page until they are written to
      auto filled = std::make_unique<Page>();
      filled->element.fill(value);
      filled->owners = static_cast<std::uint32_t>(pages - pages_.size());
      pages_.resize(pages, filled.release());
    }
    size_ = size;
  }
  /// Ensures that this many shared pages can be written to without allocation. If the array has
  /// fewer shared pages, this holds for all of them.
  void reserve_pages(std::size_t pages) {
    std::size_t wanted = 0;
    for (std::size_t i = 0; i < pages_.size() && wanted < pages; ++i)
      wanted += is_shared(pages_[i]) ? 1 : 0;
    spare_.reserve(wanted);
    while (spare_.size() < wanted)
      spare_.push_back(std::make_unique<Page>().release());
  }
  std::size_t pages() const noexcept { return pages_.size(); }
  /// Memory of the pages in bytes, spare pages included. A page that this array uses several times
  /// (resize()) counts each time, and a page that copies share counts for each copy.
  std::size_t bytes() const noexcept { return (pages_.size() + spare_.size()) * sizeof(Page); }

  bool operator==(const PagedArray& other) const {
    return size_ == other.size_ && std::equal(begin(), end(), other.begin());
  }

 private:
  void swap(PagedArray& other) noexcept {
    pages_.swap(other.pages_);
    spare_.swap(other.spare_);
    std::swap(size_, other.size_);
  }
  static bool is_shared(const Page* page) noexcept {
    return page->owners.load(std::memory_order_acquire) > 1;
  }
  static void release(Page* page) noexcept {
    if (page->owners.fetch_sub(1, std::memory_order_acq_rel) == 1)
      std::unique_ptr<Page>(page).reset();
  }
  void make_own(Page*& page) noexcept {
    Page* own = nullptr;
    if (spare_.empty()) {
      own = std::make_unique<Page>().release();
    } else {
      own = spare_.back();
      spare_.pop_back();
    }
    own->element = page->element;
    release(page);
    page = own;
  }

  std::vector<Page*> pages_;  ///< each page is owned by all arrays that use it
  std::vector<Page*> spare_;  ///< pages for make_own()
  std::size_t size_ = 0;
};

}  // namespace trocar
