// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/async_mapper.h"

#include "base/timed.h"

#include <utility>

namespace dsorb::odometry {

AsyncMapper::AsyncMapper(const PinholeCamera& camera,
                         const OdometryOptions& options,
                         TaskArena& arena)
    : own_arena_(options.num_threads),
      arena_(options.pipelined ? own_arena_ : arena),
      mapper_(camera, options),
      queue_([this](const MappingJob& job) { return run([&] { return mapper_.map(job); }); },
             options.pipelined ? options.max_waiting : 0) {}

template <typename Work>
MappingResult AsyncMapper::run(const Work& work) {
  MappingResult result;
  timed(result.seconds, [&] { result.update = arena_.run(work); });
  return result;
}

MappingResult AsyncMapper::seed(const InitializationResult& result, int segment) {
  return run([&] { return std::make_unique<MapUpdate>(mapper_.seed(result, segment)); });
}

void AsyncMapper::submit(MappingJob job) {
  keyframe_is_due_ |= job.becomes_keyframe;
  queue_.submit(std::move(job));
}

std::optional<MappingResult> AsyncMapper::take() {
  std::optional<MappingResult> result = queue_.take();
  if (result && result->update) keyframe_is_due_ = false;
  return result;
}

std::vector<KeyframeSnapshot> AsyncMapper::clear() {
  queue_.discard();
  keyframe_is_due_ = false;
  return mapper_.clear();
}

}  // namespace dsorb::odometry
