// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/odometry.h"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace dsorb {

/// What Place does.
struct PlaceOptions {
  bool loops = true;    ///< finish() closes loops; a build without Ceres closes none
  int num_threads = 1;  ///< 0: all the machine has
  /// Largest probability of a wrong join that is accepted [-].
  double max_wrong_probability = 1e-4;
};

/// Whether this build closes loops: it has Ceres.
[[nodiscard]] bool canCloseLoops();

/// Sizes and counts of a Place.
struct PlaceReport {
  int keyframes = 0;          ///< that are remembered
  int joined = 0;             ///< segments that became part of another one
  int loops = 0;              ///< that were closed
  std::size_t bytes = 0;      ///< of keyframes and index
  int asked = 0;              ///< frames that the recognizer was asked about
  double asking_seconds = 0;  ///< by it
  double adding_seconds = 0;  ///< describing keyframes and following their corners
  double finish_seconds = 0;  ///< of finish()
};

/// Remembers the keyframes of a run, compact (30 kB each: corners with descriptors and depths, of
/// the newest sixteen a small image, too), and recognizes places: segments that share a view become
/// one, and loops are closed. Register it with Odometry::addObserver() and call finish() after
/// Odometry::finish(); what it finds is told to its own observers. The same input gives the same
/// bits for any number of threads.
class Place : public OdometryObserver {
 public:
  /// Remembers nothing yet.
  explicit Place(const PlaceOptions& options);
  ~Place() override;
  Place(Place&&) = delete;
  Place& operator=(Place&&) = delete;
  Place(const Place&) = delete;
  Place& operator=(const Place&) = delete;

  /// Takes over a map that save() wrote, before anything is told.
  /// @return number of its segments: they are 0 and up, those of the run begin with this one
  /// @throws IoError naming the file and what is wrong with it
  int load(const std::string& file);
  /// Answers where a frame was taken, by all keyframes that are final. This object must outlive it.
  /// @param camera of the rectified images
  [[nodiscard]] Recognizer recognizer(const PinholeCamera& camera);

  /// @param observer must outlive this object; is told onSegmentsJoined and onLoopsClosed
  void addObserver(OdometryObserver* observer);

  void onInitStep(const InitStep& step, const Frame& frame, int segment) override;
  void onFrame(const FrameEstimate& estimate) override;
  void onKeyframe(const KeyframeSnapshot& keyframe) override;
  void onKeyframeRetired(const KeyframeSnapshot& keyframe) override;
  void onStartRefused(const StartRefusal& refusal) override;

  /// Joins segments and closes loops by all that was told, and tells observers.
  PlaceReport finish();
  /// Writes the map as it is after finish(): docs/formats.md, "Maps".
  /// @throws IoError naming the file
  void save(const std::string& file) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// One map of several: what shares a view becomes one segment, in the world and unit of the first
/// map that has it.
/// @throws IoError naming the file and what is wrong with it
PlaceReport mergeMaps(const std::vector<std::string>& maps,
                      const std::string& into,
                      const PlaceOptions& options);

}  // namespace dsorb
