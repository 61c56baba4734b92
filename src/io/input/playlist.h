// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/sequence_reader.h"

#include "io/input/image_source.h"

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
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
  /// @param depth items that wait at most; 0: no thread, items are made when asked for
  PrefetchQueue(std::size_t count, int depth, std::function<std::optional<Item>(std::size_t)> make)
      : count_(count),
        depth_(depth > 0 ? static_cast<std::size_t>(depth) : 0),
        make_(std::move(make)) {
    if (depth_ > 0) worker_ = std::thread([this] { work(); });
  }
  ~PrefetchQueue() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stopped_ = true;
    }
    changed_.notify_all();
    if (worker_.joinable()) worker_.join();
  }
  PrefetchQueue(const PrefetchQueue&) = delete;
  PrefetchQueue& operator=(const PrefetchQueue&) = delete;

  /// Leaves out the next items; those not yet begun are never made.
  void skip(std::size_t items) {
    delivered_ += std::min(items, count_ - delivered_);
    if (depth_ == 0) return;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      wanted_ = delivered_;
      while (!entries_.empty() && entries_.front().position < wanted_ && entries_.front().item) {
        entries_.pop_front();
      }
    }
    changed_.notify_all();
  }

  /// @return the next item; empty after the last one or after an exception
  std::optional<Item> next() {
    if (delivered_ == count_) return std::nullopt;
    Entry entry = depth_ > 0 ? take() : makeEntry(delivered_);
    while (entry.position < delivered_ && entry.item) entry = take();  // begun before a skip
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

  Entry take() {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this] { return !entries_.empty(); });
    Entry entry = std::move(entries_.front());
    entries_.pop_front();
    lock.unlock();
    changed_.notify_all();
    return entry;
  }

  void work() {
    for (std::size_t position = 0;; ++position) {
      {
        std::unique_lock<std::mutex> lock(mutex_);
        changed_.wait(lock, [this] { return stopped_ || entries_.size() < depth_; });
        if (stopped_) return;
        position = std::max(position, wanted_);
      }
      if (position >= count_) return;
      Entry entry = makeEntry(position);
      const bool ended = !entry.item;
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        entries_.push_back(std::move(entry));
      }
      changed_.notify_all();
      if (ended) return;
    }
  }

  const std::size_t count_;
  const std::size_t depth_;
  const std::function<std::optional<Item>(std::size_t)> make_;
  std::size_t delivered_ = 0;  // of the consumer's thread alone

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Entry> entries_;
  std::size_t wanted_ = 0;  // items before are skipped
  bool stopped_ = false;
  std::thread worker_;
};

}  // namespace dsorb
