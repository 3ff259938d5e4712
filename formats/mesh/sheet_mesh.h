// SPDX-License-Identifier: Apache-2.0
// The mesh of a sheet in fixed memory: vertices and triangles in slots, in arrays whose copies share pages.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/flat_table.h"
#include "formats/mesh/predicates.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

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

// Passes a function as an argument without allocation, like std::function_ref of C++26.

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

// The mesh of a sheet, which can be edited in place. Vertices and triangles are stored in slots,
// which are array elements that are in use or free. An edit uses free slots, so the arrays never
// grow during an edit. The mesh also stores the neighbours of each triangle, so the time of an edit
// is proportional to the number of slots that the edit reads or writes.
//
// There are three reasons not to use OpenMesh 9, a library for meshes. First, OpenMesh only marks a
// deleted vertex, edge or face. The slot can be used again only after a garbage collection, which
// visits and renumbers the whole mesh. A mesh that is cut repeatedly would need this garbage
// collection or new memory. Second, OpenMesh allows only one fan of faces (faces connected by
// edges) at a vertex. If a cut leaves several fans at a vertex, faces would have to be deleted and
// added again. Third, OpenMesh keeps no list of the slots that an edit has written. This list is
// needed to undo the edit and to repeat it on a second copy of the mesh (a replica).

inline constexpr std::uint32_t kNoSlot = 0xffffffff;  ///< an index that stands for no slot
inline constexpr Triangle kFreeSlot{kNoSlot, kNoSlot, kNoSlot};

/// Invariants (tests/support/check_sheet_mesh.h verifies 1 to 3):
///  1. A triangle in use is strictly counter-clockwise and has three vertices in use. A free
///     triangle slot contains kFreeSlot, and `free_triangles` lists it exactly once.
///  2. across[t][i] is the triangle beyond edge i of t (predicates.h); kNoSlot on the sheet's
///     boundary.
///  3. A vertex in use belongs to a triangle. Its triangles form one fan: each triangle shares
///     an edge at this vertex with the next. If two fans touch at a point, each fan has a vertex
///     of its own at this point. `free_vertices` lists exactly once every vertex slot that is
///     not in use.
///  4. Only add_slots() and remove_spare_slots() change the size of `vertices`, `triangles` and
///     `across`; edits do not. Edits can push kReservedFree further slots to the stacks
///     `free_vertices` and `free_triangles` without allocation (or all slots of the mesh, if the
///     mesh has fewer). The same holds for a copy of the mesh.
/// A copy shares the memory of the arrays until one of the two is written to (PagedArray).
struct SheetMesh {
  static constexpr std::size_t kReservedFree = 32'768;

  PagedArray<LatticePoint> vertices;
  PagedArray<Triangle> triangles;
  PagedArray<std::array<std::uint32_t, 3>> across;
  std::vector<std::uint32_t> free_vertices;   ///< free vertex slots; the last one is used next
  std::vector<std::uint32_t> free_triangles;  ///< free triangle slots; the last one is used next

  SheetMesh() = default;
  ~SheetMesh() = default;
  SheetMesh(SheetMesh&&) = default;
  SheetMesh& operator=(SheetMesh&&) = default;
  SheetMesh(const SheetMesh& other)
      : vertices(other.vertices),
        triangles(other.triangles),
        across(other.across),
        free_vertices(other.free_vertices),
        free_triangles(other.free_triangles) {
    reserve_stacks();
  }
  SheetMesh& operator=(const SheetMesh& other) { return *this = SheetMesh(other); }

  /// Gives the stacks the capacity of invariant 4, and writes to all of it. Later edits then cause
  /// no page fault, the delay at the first access to a page of memory.
  void reserve_stacks() {
    const std::size_t vertices_free = free_vertices.size(), triangles_free = free_triangles.size();
    free_vertices.resize(std::min(vertices.size(), vertices_free + kReservedFree));
    free_vertices.resize(vertices_free);
    free_triangles.resize(std::min(triangles.size(), triangles_free + kReservedFree));
    free_triangles.resize(triangles_free);
  }
  /// Allocates spare pages. An edit that writes to at most this many pages of each array then
  /// allocates none, even if a copy of the mesh shares the pages.
  void reserve_pages(std::size_t pages) {
    vertices.reserve_pages(pages);
    triangles.reserve_pages(pages);
    across.reserve_pages(pages);
  }
  /// Memory of the mesh in bytes, including memory that copies share.
  std::size_t bytes() const noexcept {
    return vertices.bytes() + triangles.bytes() + across.bytes() +
           (free_vertices.capacity() + free_triangles.capacity()) * sizeof(std::uint32_t);
  }
  /// Adds free slots. Edits use the older free slots first. Therefore a mesh and its replica use
  /// slots in the same order, even if slots are added to them at different times. O(n). Allocates.
  /// Precondition: no other thread reads the mesh meanwhile.
  void add_slots(std::size_t more_vertices, std::size_t more_triangles);
  /// Removes the free slots. Precondition: make_sheet_mesh() has made the mesh, and no edit has
  /// changed it since.
  void remove_spare_slots();
  bool in_use(std::uint32_t t) const noexcept { return triangles[t][0] != kNoSlot; }
  std::size_t triangles_in_use() const noexcept { return triangles.size() - free_triangles.size(); }
  std::size_t vertices_in_use() const noexcept { return vertices.size() - free_vertices.size(); }
};

/// Returns the corners of triangle t, which must be in use.
inline std::array<LatticePoint, 3> corners(const SheetMesh& mesh, std::uint32_t t) noexcept {
  const Triangle& v = mesh.triangles[t];
  return {mesh.vertices[v[0]], mesh.vertices[v[1]], mesh.vertices[v[2]]};
}

/// Makes a sheet mesh of a slice's mesh. The first slots hold the vertices and triangles of `mesh`
/// in the same order. The `spare_vertices` and `spare_triangles` slots after them are free; edits
/// use the free slots in ascending order. Precondition: `mesh` is valid (check_mesh()). O(n).
/// Errors: kRefused if an index is out of range, or if two triangles use an edge in the same
/// direction. Other defects of `mesh` are not detected.
Result<SheetMesh> make_sheet_mesh(const SliceMesh& mesh, std::size_t spare_vertices,
                                  std::size_t spare_triangles);

/// Returns the triangles in use and their vertices, in the order of their slots. O(n).
SliceMesh to_slice_mesh(const SheetMesh& mesh);

// Lists the slots (elements of the arrays of a SheetMesh) that an edit of the mesh has written.
// With these lists the edit can be undone, or repeated on a second copy of the mesh (a replica).
// The time for this is proportional to the number of listed slots, not to the size of the mesh.
//
// Contract:
//  1. Precondition: a function that edits the mesh calls touch_*() before it writes to a slot. It
//     takes and releases slots only by take_*() and release_*(), which update the lists.
//  2. undo() restores the mesh exactly as it was at begin(): every slot and the order of
//     the free slots.
//  3. If a replica was equal to the mesh at begin(), SheetChange::copy_to() makes the replica equal
//     to the edited mesh: every slot and the order of the free slots.
//  4. Only the constructor allocates. Each slot is listed at most once, so the capacity suffices.

/// The slots that an edit has written. Together with the edited mesh, they suffice to repeat the
/// edit on a replica.
struct SheetChange {
  /// A triangle's slot and its content before the edit.
  struct OldTriangle {
    std::uint32_t slot;
    Triangle corners;  ///< kFreeSlot if the slot was free
    std::array<std::uint32_t, 3> across;
  };
  /// A vertex's slot and its content before the edit.
  struct OldVertex {
    std::uint32_t slot;
    LatticePoint point;
  };

  std::vector<OldTriangle> triangles;  ///< each slot once, in the order in which they were listed
  std::vector<OldVertex> vertices;     ///< each slot once, in the order in which they were listed
  /// SheetMesh::free_triangles and SheetMesh::free_vertices are stacks of free slots. These two
  /// numbers say how many entries at the bottom of each stack the edit has not changed.
  std::size_t untouched_free_triangles = 0, untouched_free_vertices = 0;

  /// Repeats the edit on the replica `to` (contract 3). `from` is the mesh that was edited.
  void copy_to(const SheetMesh& from, SheetMesh& to) const noexcept;
};

class SheetEdit {
 public:
  using OldTriangle = SheetChange::OldTriangle;
  using OldVertex = SheetChange::OldVertex;

  SheetEdit() = default;
  /// Allocates memory for edits of meshes with no more slots than `mesh`. O(slots).
  explicit SheetEdit(const SheetMesh& mesh)
      : SheetEdit(mesh.vertices.size(), mesh.triangles.size()) {}
  SheetEdit(std::size_t vertex_slots, std::size_t triangle_slots);

  /// Starts a new edit of `mesh` and clears the lists. O(1).
  void begin(const SheetMesh& mesh) noexcept;

  /// Call this before you write to a slot. Lists the slot with its content, unless the slot is
  /// already listed.
  void touch_triangle(const SheetMesh& mesh, std::uint32_t t) noexcept;
  void touch_vertex(const SheetMesh& mesh, std::uint32_t v) noexcept;

  /// Takes a free slot, writes the given content to it, and returns its index. Returns kNoSlot if
  /// there is no free slot.
  std::uint32_t take_triangle(SheetMesh& mesh, const Triangle& corners) noexcept;
  std::uint32_t take_vertex(SheetMesh& mesh, LatticePoint point) noexcept;
  /// Frees the slot. The caller must ensure that nothing refers to the slot at the end of the edit.
  void release_triangle(SheetMesh& mesh, std::uint32_t t) noexcept;
  void release_vertex(SheetMesh& mesh, std::uint32_t v) noexcept;

  /// The slots that were written since begin(), each once, in the order in which they were listed.
  std::span<const OldTriangle> triangles() const noexcept { return change_.triangles; }
  std::span<const OldVertex> vertices() const noexcept { return change_.vertices; }
  const SheetChange& change() const noexcept { return change_; }

  /// Undoes the edit (contract 2) and calls begin() for a new edit.
  void undo(SheetMesh& mesh) noexcept;

 private:
  // Pops a slot from a stack of free slots. `untouched` is SheetChange::untouched_free_triangles or
  // untouched_free_vertices. `popped` lists the entries that the stack had at begin() and that have
  // been popped since then, topmost first.
  static std::uint32_t pop(std::vector<std::uint32_t>& stack, std::size_t& untouched,
                           std::vector<std::uint32_t>& popped) noexcept;

  SheetChange change_;
  std::vector<std::uint32_t> popped_triangles_, popped_vertices_;
  FlatTable triangle_listed_, vertex_listed_;  ///< slots that are already listed
};

}  // namespace trocar
