// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/frame.h"
#include "dsorb/options/brightness.h"

#include <Eigen/Core>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace dsorb {

/// Kind of a data set; kAuto recognises it by what lies there.
enum class SequenceFormat { kAuto, kDso, kKitti, kEuroc, kTum, kImages, kVideo, kCamera };

/// Longer side of images without a calibration: larger ones are made smaller [px].
constexpr int kMostGuessedSide = 1280;

/// Which images are read, and how.
struct SequenceOptions {
  /// Folder of a data set or of images, .zip of images, video file, /dev/videoN or rtsp://... A
  /// video file with the format kCamera is played like a camera, in its own time.
  std::string path;
  SequenceFormat format = SequenceFormat::kAuto;  ///< format of what lies at `path`
  std::string calibration_file;                   ///< empty: the one of the data set
  /// Camera of a calibration file with several, as CameraChoice::name; empty: the one that a folder
  /// of the images is called after.
  std::string camera;
  /// [degrees] of a lens without distortion; 0: a calibration is read, and without one nothing is
  /// known of the lens, which Lens::focal_sigma then says.
  double horizontal_view = 0;
  std::optional<Lens> lens;        ///< of the images as they are, instead of a calibration
  std::optional<Readout> readout;  ///< replaces the calibration's
  std::string response_file;       ///< empty: pcalib.txt of the data set, if there
  std::string vignette_file;       ///< empty: vignette.png of the data set, if there
  /// Image of pixels that no image uses (below 128), beside those of masks/ of the data set, if
  /// there; or another folder with one for each image under its name (or with .png after or instead
  /// of its suffix).
  std::string mask;
  /// Relative standard deviation of the depth images in depth/ of the data set, one for each image
  /// (16 bits, millimetres, rectified): frames have them as priors. 0: they are not read.
  double depth_sigma = 0;
  /// Rates of a gyroscope: lines of time [s or ns], wx, wy, wz [rad/s], as imu0/data.csv of EuRoC.
  /// Frames have the rotation since the one before as a prior. Empty: none.
  std::string gyroscope_file;
  Eigen::Matrix3d R_cam_gyro = Eigen::Matrix3d::Identity();  ///< its axes to those of the camera
  /// Empty: calibrated where response and vignette are there, else uncalibrated.
  std::optional<BrightnessModel> brightness;
  int bits = 0;     ///< that values of 16-bit files take, 9 to 16; 0: recognised by their largest
  int start = 0;    ///< first image
  int end = -1;     ///< one past the last image; negative or too large: the number of images
  double from = 0;  ///< [s] after the first image of the data set
  double to = 0;    ///< [s] after the first image of the data set; 0: the last one
  int every = 1;    ///< use each N-th image, beginning with the first selected
  /// Width of the rectified images [px], less than without; 0: as calibrated. Below 0: the same,
  /// but of a lens that is a guess at most so much that no side is longer than kMostGuessedSide.
  int width = -1;
  bool reverse = false;          ///< read from end - 1 down to start, both included
  bool skip_unreadable = false;  ///< pass over image files that cannot be read
  /// Each image is prepared while the one before is used, in a thread; not with cameras.
  bool prefetch = true;
  /// Where the lens is a guess: keeps decoded images, 128 MB at most, for a reader that goes on
  /// from this one; not of cameras.
  bool keep_decoded = false;
};

/// One rectified and photometrically corrected image with its pyramid.
struct SequenceFrame {
  int index = -1;                     ///< position in the sequence, also the frame's id
  FramePtr frame;                     ///< rectified
  std::string image_file;             ///< empty: the image is no file, as of a video
  std::vector<std::string> warnings;  ///< one sentence each, about the image as it was read
  double read_milliseconds = 0;       ///< reading, decoding, correction, rectification [ms]
  double pyramid_milliseconds = 0;    ///< Frame::create [ms]
  bool late = false;                  ///< the image behind it is there, too: of a camera
};

/// Reads a data set image by image: DSO/TUM-mono folder (images or images.zip), KITTI odometry,
/// EuRoC ASL, TUM RGB-D, a plain folder of images with a calibration file, a video, or a camera,
/// four images of which wait for a late caller. Images are prepared ahead in the background; the
/// reader itself is used by one thread.
class SequenceReader {
 public:
  /// @throws IoError on a missing or malformed data set or calibration
  /// @throws ConfigError on options that contradict each other or the data set
  explicit SequenceReader(const SequenceOptions& options);
  /// Reads the images of another reader again, with options that differ in the lens alone: those
  /// that it kept are not decoded again.
  SequenceReader(const SequenceOptions& options, SequenceReader before);
  ~SequenceReader();
  SequenceReader(SequenceReader&&) noexcept;  ///< the other may only be destroyed or assigned to
  SequenceReader& operator=(
      SequenceReader&&) noexcept;  ///< the other may only be destroyed or assigned to

  /// Camera of the rectified images.
  [[nodiscard]] const PinholeCamera& camera() const;
  /// The camera that took them, for images of the size that they have.
  [[nodiscard]] const Lens& lens() const;
  /// Number of images in the data set; of a video as its container announces it, of a camera 0.
  [[nodiscard]] int size() const;
  /// Number of images that next() delivers in all; of a video as its container announces it, of a
  /// camera 0.
  [[nodiscard]] int selected() const;
  /// The format that was recognised, never kAuto.
  [[nodiscard]] SequenceFormat format() const;
  /// The brightness model in force.
  [[nodiscard]] BrightnessModel brightness() const;
  /// Time of any image [s]; 0.1 * index where the data set has no times. Those of a video are known
  /// only with its images, here they follow from its rate. None of a camera.
  [[nodiscard]] double timestamp(int index) const;

  /// What speaks against data set or calibration without making it unreadable, one sentence each.
  [[nodiscard]] const std::vector<std::string>& warnings() const;

  /// Index of the image that next() delivers as the position-th, counted from 0.
  [[nodiscard]] int index(int position) const;

  /// Images that a camera gave and that were dropped for newer ones before they were asked for.
  [[nodiscard]] int dropped() const;

  /// Files that could not be read and were passed over, so far.
  [[nodiscard]] const std::vector<std::string>& unreadable() const;

  /// Leaves out the next images, unread as far as they are not yet prepared.
  void skip(int images);

  /// @return the next selected image; empty after the last one
  /// @throws IoError where this image cannot be read and is not to be passed over; nothing follows
  [[nodiscard]] std::optional<SequenceFrame> next();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dsorb
