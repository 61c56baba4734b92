// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {

/// Images of a camera that wait for a late caller, as many as drivers of Video4Linux usually hold;
/// the oldest is dropped for one too many.
inline constexpr std::size_t kCameraBuffers = 4;

/// One image as it is stored or sent.
struct SourceImage {
  int index = 0;
  cv::Mat pixels;                   ///< 8 or 16 bits of grey, or 8 bits of BGR
  std::optional<double> timestamp;  ///< [s]; empty: the data set says it
  std::string warning;              ///< one sentence; empty: none
  bool late = false;                ///< the image behind it is there, too: of a camera
  /// How far the sensor's image was turned clockwise to be upright: 0, 90, 180 or 270 degrees.
  int turn = 0;
  double pixel_aspect = 1;  ///< width of a pixel over its height
};

/// Where images come from: files, an archive, a video, a camera. One thread at a time uses it.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// Number of images; of a video as its container announces it, of a camera 0.
  [[nodiscard]] virtual int size() const = 0;
  /// Rate of the images of a video as the container announces it [1/s].
  [[nodiscard]] virtual double rate() const { return 0; }
  /// Time of the first image of a video [s].
  [[nodiscard]] virtual double begin() const { return 0; }
  /// Name of an image, for messages and reports.
  [[nodiscard]] virtual std::string name(int index) const = 0;
  /// The image of this position. A video goes forwards only, and its last one may be asked for
  /// again; a camera gives the oldest of its images that wait, which is not that of the position.
  /// @return empty after the last image
  /// @throws IoError where it cannot be read
  [[nodiscard]] virtual std::optional<SourceImage> image(int index) = 0;
  /// Goes to the first image at least so many seconds after the first one, where times come with
  /// the images: in a video.
  /// @return its index; that after the last one where there is none
  [[nodiscard]] virtual int seek(double /*seconds*/) { return 0; }
  /// Images that a camera gave and that were dropped for newer ones before they were asked for.
  [[nodiscard]] virtual int dropped() const { return 0; }
};

/// Encoded images by position, of files or of an archive.
class ImageStore : public ImageSource {
 public:
  /// Reads the bytes of a name. @throws IoError where it cannot be read
  using Read = std::function<std::vector<std::uint8_t>(const std::string& name)>;

  /// @param names    of the images
  /// @param left_out files that look as if they were read and are not
  ImageStore(std::vector<std::string> names, std::vector<std::string> left_out, Read read)
      : names_(std::move(names)), left_out_(std::move(left_out)), read_(std::move(read)) {}
  [[nodiscard]] int size() const final { return static_cast<int>(names_.size()); }
  /// File of an image.
  [[nodiscard]] std::string name(int index) const final {
    return names_[static_cast<std::size_t>(index)];
  }
  [[nodiscard]] std::optional<SourceImage> image(int index) final;
  /// Files that look as if they were read and are not: images that are none of the sequence, and in
  /// an archive what is read beside it.
  [[nodiscard]] const std::vector<std::string>& leftOut() const { return left_out_; }

 private:
  std::vector<std::string> names_;
  std::vector<std::string> left_out_;
  Read read_;
};

/// Images given as a list of files, in that order.
std::unique_ptr<ImageStore> openImageList(const std::vector<std::filesystem::path>& files);

/// Images of a folder or of a .zip archive in the order of their names, numbers in them by
/// value. Hidden files, sub-folders and files without the suffix of an image are ignored; images
/// without a number among numbered ones, as a vignette or a mask, are left out.
/// @param others  images that may lie there, too, and are none of the sequence
/// @throws IoError where it is missing, unreadable, or holds no image
std::unique_ptr<ImageStore> openImageStore(const std::filesystem::path& path,
                                           const std::vector<std::filesystem::path>& others = {});

/// Whether a folder holds at least one image.
bool holdsImages(const std::filesystem::path& folder);

/// Whether a path is /dev/videoN or an address like rtsp://...
[[nodiscard]] bool isCameraAddress(const std::string& path);

/// A video file: goes forwards only, times from its container.
/// @throws IoError where it cannot be decoded or holds no image, or this build reads no videos.
///         image() throws where the file ends long before the end that its container announces.
[[nodiscard]] std::unique_ptr<ImageSource> openVideo(const std::filesystem::path& file);

/// A device, an address, or a video file that is played like a camera in its own time. A thread
/// takes every image; image() waits for one that is newer than the last and never gives an older
/// one than the newest. Times are seconds since 1970, of a file those of its container.
/// The end of its life takes up to half a second where an image is being read; a read that does not
/// return is left to its thread, which ends with it.
/// @throws IoError where it cannot be opened within ten seconds, and from image() where nothing
///         comes for five seconds or the camera goes away
[[nodiscard]] std::unique_ptr<ImageSource> openCamera(const std::string& address);

}  // namespace dsorb
