// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/sequence_reader.h"

#include "io/input/image_source.h"

#include <tbb/concurrent_queue.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <functional>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

namespace dsorb {

/// Which images of a source are read, in this order.
struct Playlist {
  std::size_t count = 0;     ///< at most; images may end before
  std::size_t expected = 0;  ///< number of images as far as known
  int first = 0;
  int step = 1;              ///< negative: backwards
  std::optional<double> to;  ///< [s]: nothing after it, where times come with the images

  [[nodiscard]] int index(std::size_t position) const {
    return first + static_cast<int>(position) * step;
  }
  [[nodiscard]] bool isAfterEnd(std::optional<double> timestamp) const {
    return to && timestamp && *timestamp > *to;
  }
};

/// Images selected by start, end, from, to, every and reverse.
/// @param timestamps [s], one for each image
/// @throws ConfigError where nothing is selected
Playlist selectImages(const SequenceOptions& options,
                      int size,
                      const std::vector<double>& timestamps);

/// Images of a video selected by start, end, from, to and every.
/// @param begin, rate time of the first image [s], and images per second
/// @throws ConfigError where nothing is selected, and on `reverse`
Playlist selectVideo(const SequenceOptions& options, ImageSource& video, double begin, double rate);

/// Images of a camera: `end` of them, or without end.
/// @throws ConfigError on any other selection
Playlist selectLive(const SequenceOptions& options);

/// Makes items 0 .. count - 1 in order, some ahead of their use in a thread of its own. The maker
/// ends the queue earlier by making nothing, or by an exception, which is delivered in its place.
template <typename Item>
class PrefetchQueue {
 public:
  /// @param depth items that are made ahead at most; 0: no thread, items are made when asked for
  PrefetchQueue(std::size_t count, int depth, std::function<std::optional<Item>(std::size_t)> make)
      : count_(count), make_(std::move(make)) {
    if (depth <= 0) return;
    made_.set_capacity(std::max(1, depth - 1));  // and one that waits for its place
    worker_ = std::thread([this] { work(); });
  }
  ~PrefetchQueue() {
    stopped_ = true;
    for (Entry entry; made_.try_pop(entry);) {
    }
    if (worker_.joinable()) worker_.join();
  }
  PrefetchQueue(const PrefetchQueue&) = delete;
  PrefetchQueue& operator=(const PrefetchQueue&) = delete;

  /// Leaves out the next items; those not yet begun are never made.
  void skip(std::size_t items) {
    delivered_ += std::min(items, count_ - delivered_);
    wanted_ = delivered_;
  }

  /// @return the next item; empty after the last one or after an exception
  std::optional<Item> next() {
    if (delivered_ == count_) return std::nullopt;
    Entry entry;
    do {
      if (worker_.joinable()) {
        made_.pop(entry);
      } else {
        entry = makeEntry(delivered_);
      }
    } while (entry.position < delivered_ && entry.item);  // begun before a skip
    if (!entry.item) delivered_ = count_;
    if (entry.error) std::rethrow_exception(entry.error);
    if (!entry.item) return std::nullopt;
    ++delivered_;
    return std::move(entry.item);
  }

 private:
  struct Entry {
    std::size_t position = 0;
    std::optional<Item> item;
    std::exception_ptr error;
  };

  Entry makeEntry(std::size_t position) {
    Entry entry;
    entry.position = position;
    try {
      entry.item = make_(position);
    } catch (...) {
      entry.error = std::current_exception();
    }
    return entry;
  }

  void work() {
    bool ended = false;
    for (std::size_t position = 0; !ended && !stopped_; ++position) {
      position = std::max(position, wanted_.load());
      if (position >= count_) return;
      Entry entry = makeEntry(position);
      ended = !entry.item;
      made_.push(std::move(entry));
    }
  }

  const std::size_t count_;
  const std::function<std::optional<Item>(std::size_t)> make_;
  std::size_t delivered_ = 0;  // of the consumer's thread alone
  tbb::concurrent_bounded_queue<Entry> made_;
  std::atomic<std::size_t> wanted_ = 0;  // items before are skipped
  std::atomic<bool> stopped_ = false;
  std::thread worker_;
};

}  // namespace dsorb
