// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/parallel.h"
#include "base/worker_queue.h"
#include "odometry/mapper.h"

#include <memory>
#include <optional>
#include <vector>

namespace dsorb::odometry {

struct MappingResult {
  double seconds = 0;
  std::unique_ptr<MapUpdate> update;  ///< of a keyframe, else null
};

/// A mapper behind a queue: pipelined, it works in a thread of its own, else within submit(). One
/// thread at a time may call it.
class AsyncMapper {
 public:
  /// @param arena of the calling thread; used where the mapper has no thread of its own
  AsyncMapper(const PinholeCamera& camera, const OdometryOptions& options, TaskArena& arena);

  /// Starts a new map, at once. The queue must be empty: clear() makes it so.
  [[nodiscard]] MappingResult seed(const InitializationResult& result, int segment);
  /// Puts a frame into the queue; waits while that is full.
  void submit(MappingJob job);
  /// @return the oldest result not yet taken; empty: there is none at the moment
  /// @throws what the mapper threw
  [[nodiscard]] std::optional<MappingResult> take();
  /// Whether there is work or a result to come.
  [[nodiscard]] bool busy() const { return queue_.busy(); }
  /// Whether a frame was submitted as a keyframe whose result is not yet taken.
  [[nodiscard]] bool keyframeIsDue() const { return keyframe_is_due_; }
  /// Waits until all submitted frames are mapped.
  void wait() { queue_.wait(); }
  /// Gives up queue and map. @return the map's keyframes, oldest first
  std::vector<KeyframeSnapshot> clear();

 private:
  template <typename Work>
  MappingResult run(const Work& work);

  TaskArena own_arena_;  // two threads in one arena of one thread would wait for each other
  TaskArena& arena_;
  Mapper mapper_;  // belongs to the queue while that is busy
  bool keyframe_is_due_ = false;
  WorkerQueue<MappingJob, MappingResult> queue_;  // last: its thread ends first
};

}  // namespace dsorb::odometry
